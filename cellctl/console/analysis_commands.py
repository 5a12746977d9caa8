"""Commands of analyses, for page and API alike: each in a process of its own, with its lines in the audit log."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, final

from cellctl.console.commands import command_job, result_of
from cellctl.console.jobs import Adopted, Job
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.files import InputError, Problem
from cellctl.journal.journal_file import lock_holder
from cellctl.operations import analyses
from cellctl.operations.analyses import FitSettings
from cellctl.operations.analysis_programs import ProgramRequest, new_program


@final
@dataclass(frozen=True)
class Upload:
    """An uploaded file: its name, and what writes its content to a path."""

    name: str
    save: Callable[[Path], Awaitable[Any]]


async def upload(
    operator: Operator,
    data: Upload,
    others: Mapping[str, Upload],
    library: str = "",
    answers: Mapping[str, str] | None = None,
) -> str:
    """A new analysis of `data`; its name. others: `positions`, `artefact`, `robot`. library: name of the robot.

    Raises InputError where a file cannot be read; nothing is kept then.
    """

    async def work() -> str:
        folder, record = await asyncio.to_thread(analyses.new_analysis, console().runs, operator.name, data.name)
        try:
            await data.save(folder / record.data)
            names = {}
            for role, each in others.items():
                names[role] = analyses.free_name(folder, each.name, role)
                await each.save(folder / names[role])
            record = replace(record, answers=answers or {}, positions=names.get("positions", ""))
            replace(record, artefact=names.get("artefact", ""), robot=names.get("robot", "")).save(folder)
            if library:
                analyses.set_robot(folder, library)
            await result_of(_understanding(operator, folder))
        except BaseException:
            await asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True)
            raise
        return folder.name

    return await console().command(operator, "upload", data.name, work)


async def example(operator: Operator) -> str:
    """A new analysis of the simulated example; its name."""

    async def save(path: Path) -> None:
        await asyncio.to_thread(shutil.copyfile, analyses.EXAMPLE, path)

    return await upload(operator, Upload(analyses.EXAMPLE.name, save), {}, analyses.EXAMPLE_ROBOT)


async def choose_robot(
    operator: Operator, name: str, library: str = "", file: Upload | None = None, repeatability: str = ""
) -> None:
    """Another robot for the analysis `name`: of the library, or of a robot file or URDF. Raises InputError.

    repeatability: of a URDF's robot, mm.
    """
    folder = _idle(name)

    async def work() -> None:
        given = ""
        if file is not None:
            given = analyses.free_name(folder, file.name, "robot")
            await file.save(folder / given)
        before = analyses.Analysis.load(folder)
        if repeatability:
            replace(before, answers={**before.answers, "repeatability": repeatability}).save(folder)
        analyses.set_robot(folder, library, given)
        try:
            await result_of(_understanding(operator, folder))
        except InputError:
            before.save(folder)
            raise

    await console().command(operator, "choose robot", name, work, robot=library or (file.name if file else ""))


async def start_fit(operator: Operator, name: str, settings: FitSettings) -> Job:
    """Start the fit of the analysis `name`. Raises InputError while another job works on it."""

    def start() -> Job:
        folder = _idle(name)
        _refuse_options(folder, settings)
        request = {"folder": str(folder), "settings": asdict(settings)}
        return console().jobs.start(f"Fit of {name}", "fit", request, operator.name, target=name)

    return await command_job(operator, "fit", name, start, settings=asdict(settings))


async def compensate(
    operator: Operator, name: str, files: Sequence[Upload], request: Mapping[str, Any]
) -> dict[str, Any]:
    """Compensate a program or targets with the model of the analysis `name`. request: as `ProgramRequest`, without
    `files`. Raises InputError.
    """
    folder = _idle(name)
    names = [analyses.safe_name(each.name) for each in files]
    if twice := sorted({safe for safe in names if names.count(safe) > 1}):
        raise InputError(Problem(", ".join(twice), 0, 0, "is there more than once", "give each file once"))

    async def work() -> dict[str, Any]:
        given = await asyncio.to_thread(new_program, folder)
        try:
            for each, safe in zip(files, names, strict=True):
                await each.save(given / safe)
            program = ProgramRequest(tuple(names), **request)
            made = {"folder": str(folder), "number": given.parent.name, "program": asdict(program)}
            title = f"Compensation with {name}"
            job = console().jobs.start(title, "compensate", made, operator.name, target=name)
            found: dict[str, Any] = await result_of(job)
        except BaseException:
            await asyncio.to_thread(shutil.rmtree, given.parent, ignore_errors=True)
            raise
        return found

    return await console().command(operator, "compensate", name, work, files=[each.name for each in files])


async def cancel(operator: Operator, name: str) -> None:
    """End what works on the analysis `name`; nothing if nothing does."""
    job = job_of(name)

    async def work() -> None:
        if job:
            job.cancel()

    await console().command(operator, "cancel", name, work)


async def delete(operator: Operator, name: str) -> None:
    """Delete the analysis `name` with its files. Raises InputError while a job works on it."""
    folder = _idle(name)
    await console().command(operator, "delete", name, lambda: asyncio.to_thread(shutil.rmtree, folder))


def job_of(name: str) -> Job | None:
    """The job that works on the analysis `name` now; a process of an earlier console is followed from here on."""
    active = console().jobs.active(name)
    if active:
        return active[-1]
    folder = analyses.analysis_folder(console().runs, name)
    holder = lock_holder(folder / analyses.LOCK)
    if holder is None or not holder.pid.isdecimal():
        return None
    process = Adopted(
        int(holder.pid),
        alive=lambda: lock_holder(folder / analyses.LOCK) is not None,
        result=lambda: analyses.read_json(folder / analyses.OUTCOME),
    )
    return console().jobs.adopt(f"Fit of {name}", "fit", process, "", target=name)


def _understanding(operator: Operator, folder: Path) -> Job:
    title, request = f"Reading {folder.name}", {"folder": str(folder)}
    return console().jobs.start(title, "understand", request, operator.name, target=folder.name)


def _idle(name: str) -> Path:
    """The folder of an analysis that no job works on."""
    folder = analyses.analysis_folder(console().runs, name)
    if job := job_of(name):
        raise InputError(Problem(name, 0, 0, f"is at work: {job.title}", "wait for its end, or cancel it"))
    return folder


def _refuse_options(folder: Path, settings: FitSettings) -> None:
    record = replace(analyses.Analysis.load(folder), settings=settings)
    record.asked().refuse(settings.judging())
    if not record.robot:
        raise InputError(Problem(record.data, 0, 0, "no robot is chosen", "choose one, or give a robot file"))
