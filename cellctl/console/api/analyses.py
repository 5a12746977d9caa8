"""Analyses without a cell: upload, robot, fit, results, compensated programs."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, File, Form, UploadFile
from fastapi import Path as PathParameter
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from cellctl.console import analysis_commands as commands
from cellctl.console.api.answers import COMMANDS, READS, AnalysisName, Commander, Refused
from cellctl.console.commands import REPORT_CONTENT
from cellctl.console.shared import console
from cellctl.files import InputError
from cellctl.operations import analyses
from cellctl.operations.analyses import ProgramEntry, TargetsEntry
from cellctl.operations.results import as_json
from cellctl.operations.robot_library import robots

router = APIRouter(prefix="/api", tags=["analyses"])

_MEDIA = {".html": "text/html", ".json": "application/json", ".urdf": "application/xml", ".csv": "text/csv"}


_REPEATABILITY = "Of a URDF's robot: 1 σ in 3-D, mm"
_Number = Annotated[str, PathParameter(description="`id` of the compensated program")]
_FileName = Annotated[str, PathParameter(description="Name of the file")]


class FitRequest(BaseModel):
    """Options of a fit, as those of `cellctl fit`."""

    model: str = Field(default="auto", description="auto, registration, geometry, zeros, or effects joined by +")
    measure: str | None = Field(default=None, description="Use rows of one kind only: position, pose, sphere, …")
    holdout: float | None = Field(default=None, description="Share of the rows held out at random, 0 to 1")
    folds: int | None = Field(default=None, description="Number of parts for cross-validation")
    by: str | None = Field(default=None, description="Hold out each value of this column in turn")
    seed: int = Field(default=0, ge=0, description="Seed of the random hold-out")
    check: bool = Field(default=True, description="Check for set-up errors first")


class Progress(BaseModel):
    """What works on an analysis now."""

    doing: str = Field(description="Current activity")
    share: float = Field(description="Share of the work that is done, 0 to 1")
    time_left: str = Field(description="Such as `36 s left`; empty while it is not known")
    job: str


class AnalysisOut(BaseModel):
    """An analysis: its record, its state and its results. Lengths in mm, angles in deg."""

    name: str
    created: str = Field(description="UTC, ISO 8601")
    operator: str = Field(description="Who uploaded the data")
    data: str = Field(description="File as uploaded")
    positions: str = Field(description="Table of positions, empty for none")
    artefact: str = Field(description="File with spheres, sockets, distances, empty for none")
    dataset: str = Field(description="Data set that is fitted: `data`, or what an import made of it")
    robot: str = Field(description="Robot file, empty until one is chosen")
    library: str = Field(description="Name of the robot in the library, empty for an own file")
    answers: dict[str, str] = Field(description="To questions of an import, by option")
    settings: FitRequest = Field(description="Options of the latest fit")
    state: Literal["new", "running", "done", "failed", "cancelled", "cut off"]
    process: int | None = Field(description="Process that fits now")
    outcome: dict[str, Any] | None = Field(
        description="Of the fit: code (exit code of `cellctl fit`), meaning, verdict, sentence, failure, notes"
    )
    files: list[str] = Field(description="Results that can be downloaded")
    programs: list[ProgramEntry | TargetsEntry] = Field(description="Compensated programs and targets")
    understood: dict[str, Any] | None = Field(
        default=None, description="What the data were understood as: figures, facts in words, problems, suggestions"
    )
    progress: Progress | None = None


class RobotName(BaseModel):
    """A robot of the library."""

    name: str = Field(description="Name in the library")
    robot: str
    joints: int
    reach_mm: float = Field(description="Greatest distance of the flange from axis 1, mm")


@router.get("/robots")
async def library() -> list[RobotName]:
    """The library of nominal robots."""
    found = await asyncio.to_thread(lambda: [each.to_json() for each in robots()])
    return [RobotName(**{name: each[name] for name in RobotName.model_fields}) for each in found]


@router.get("/analyses")
async def list_analyses() -> list[AnalysisOut]:
    """All analyses, the newest first: files, robot, state, outcome."""
    return [AnalysisOut(**as_json(each)) for each in await asyncio.to_thread(analyses.analyses, console().runs)]


@router.post("/analyses", status_code=201, responses=COMMANDS)
async def upload(
    operator: Commander,
    data: Annotated[UploadFile, File(description="Data set (CSV), table, or robot program with `positions`")],
    positions: Annotated[UploadFile | None, File(description="Table of measured positions")] = None,
    artefact: Annotated[UploadFile | None, File(description="File with spheres, sockets, distances (YAML)")] = None,
    robot: Annotated[UploadFile | None, File(description="Robot file (YAML) or URDF")] = None,
    library: Annotated[str, Form(description="Name of a library robot in place of a robot file")] = "",
    repeatability: Annotated[str, Form(description=_REPEATABILITY)] = "",
    unit: Annotated[str, Form(description="Unit of X, Y, Z, if no heading names it")] = "",
    angles: Annotated[str, Form(description="Unit of the joints, if ambiguous: deg, rad")] = "",
    decimal: Annotated[str, Form(description="Decimal sign, if ambiguous: comma, point")] = "",
    pair: Annotated[str, Form(description="Pair the rows of both files by: name, order")] = "",
    orientation: Annotated[str, Form(description="Convention of orientations in a table")] = "",
    columns: Annotated[str, Form(description="Column=heading, joined by commas: A1=shoulder,X=north")] = "",
) -> AnalysisOut:
    """Upload a data file; the answer says what was understood. A file that cannot be read leaves nothing behind."""
    given = {"positions": positions, "artefact": artefact, "robot": robot}
    others = {role: _upload(each) for role, each in given.items() if each is not None}
    texts = {"unit": unit, "angles": angles, "decimal": decimal, "pair": pair, "orientation": orientation}
    answers = {
        name: text for name, text in {**texts, "columns": columns, "repeatability": repeatability}.items() if text
    }
    return await _state(await commands.upload(operator, _upload(data), others, library, answers))


@router.get("/analyses/{name}", responses=READS)
async def analysis(name: AnalysisName) -> AnalysisOut:
    """An analysis: files, what was understood, progress of its fit, outcome, compensated programs."""
    return await _state(name)


@router.post("/analyses/{name}/robot", responses=COMMANDS)
async def robot(
    operator: Commander,
    name: AnalysisName,
    library: Annotated[str, Form(description="Name of a library robot")] = "",
    file: Annotated[UploadFile | None, File(description="Robot file (YAML) or URDF")] = None,
    repeatability: Annotated[str, Form(description=_REPEATABILITY)] = "",
) -> AnalysisOut:
    """Choose another robot: the data are compared with it."""
    _idle(name)
    await commands.choose_robot(operator, name, library, _upload(file) if file else None, repeatability)
    return await _state(name)


@router.post("/analyses/{name}/fit", status_code=202, responses=COMMANDS)
async def fit(operator: Commander, name: AnalysisName, request: FitRequest) -> AnalysisOut:
    """Start the fit; `GET /api/analyses/{name}` shows its progress and outcome."""
    _idle(name)
    await commands.start_fit(operator, name, analyses.FitSettings(**request.model_dump()))
    return await _state(name)


@router.post("/analyses/{name}/cancel", responses=COMMANDS)
async def cancel(operator: Commander, name: AnalysisName) -> AnalysisOut:
    """End what works on the analysis."""
    _folder(name)
    await commands.cancel(operator, name)
    return await _state(name)


@router.delete("/analyses/{name}", status_code=204, responses=COMMANDS)
async def delete(operator: Commander, name: AnalysisName) -> None:
    """Delete the analysis with its files."""
    _idle(name)
    await commands.delete(operator, name)


@router.post("/analyses/{name}/programs", status_code=201, responses=COMMANDS)
async def compensate(
    operator: Commander,
    name: AnalysisName,
    files: Annotated[
        list[UploadFile], File(description="A .src with its .dat and $config.dat, a .script, or a file of targets")
    ],
    tool: Annotated[str, Form(description="Tool of the program, X,Y,Z,A,B,C in mm and deg, without $config.dat")] = "",
    base: Annotated[str, Form(description="Base of the program, X,Y,Z,A,B,C in mm and deg")] = "",
    orientation: Annotated[str, Form(description="Convention of orientations in a table of targets")] = "",
    arm_only: Annotated[bool, Form(description="Correct the arm, not the tool")] = False,
    insert: Annotated[bool, Form(description="Add points on LIN and CIRC that leave the tolerance")] = False,
) -> dict[str, Any]:
    """Compensate a program or targets with the model: files, and predicted deviations in mm."""
    _idle(name)
    request = {"tool": tool, "base": base, "orientation": orientation, "arm_only": arm_only, "insert": insert}
    return await commands.compensate(operator, name, [_upload(each) for each in files], request)


@router.get("/analyses/{name}/report", response_class=FileResponse, responses=READS)
async def report(name: AnalysisName) -> FileResponse:
    """The report of the fit as a page."""
    return FileResponse(
        _file(_folder(name) / analyses.REPORT),
        media_type="text/html",
        headers={"content-security-policy": REPORT_CONTENT},
    )


@router.get("/analyses/{name}/files/{file}", response_class=FileResponse, responses=READS)
async def download(name: AnalysisName, file: _FileName) -> FileResponse:
    """A file of the analysis: model.json, report.html, robot.urdf, fit.json, its data set or robot file."""
    state = await asyncio.to_thread(analyses.state_of, _folder(name))
    if file not in (*state.files, state.data, state.dataset, state.robot):
        raise Refused(404, f"there is no file '{file}' in this analysis", "GET the analysis: `files` lists them")
    return _download(_folder(name) / file, f"{name}-{file}" if file in analyses.RESULTS else file)


@router.get("/analyses/{name}/programs/{number}/{file}", response_class=FileResponse, responses=READS)
async def program(
    name: AnalysisName,
    number: Annotated[str, PathParameter(description="`id` of the compensated program")],
    file: _FileName,
) -> FileResponse:
    """A file of a compensated program."""
    folder = _folder(name)
    known = next((each for each in analyses.programs(folder) if each.id == number), None)
    if known is None or file not in known.files:
        raise Refused(404, f"there is no compensated file '{file}'", "GET the analysis: `programs` lists them")
    return _download(folder / "programs" / number / file, file)


async def _state(name: str) -> AnalysisOut:
    folder = _folder(name)
    state = await asyncio.to_thread(analyses.state_of, folder)
    understood = await asyncio.to_thread(analyses.read_json, folder / analyses.UNDERSTOOD)
    job = commands.job_of(name)
    progress = Progress(doing=job.doing, share=job.share, time_left=job.time_left, job=job.id) if job else None
    return AnalysisOut(**as_json(state), understood=understood, progress=progress)


def _folder(name: str) -> Path:
    try:
        return analyses.analysis_folder(console().runs, name)
    except InputError as error:
        raise Refused(404, f"there is no analysis '{name}'", "GET /api/analyses lists them") from error


def _idle(name: str) -> None:
    _folder(name)
    if job := commands.job_of(name):
        raise Refused(409, f"the analysis is at work: {job.title}", "wait for its end, or cancel it")


def _file(path: Path) -> Path:
    if not path.is_file():
        raise Refused(404, f"{path.name} is not there yet", "fit first")
    return path


def _download(path: Path, name: str) -> FileResponse:
    kind = _MEDIA.get(path.suffix, "application/octet-stream")
    return FileResponse(_file(path), media_type=kind, filename=name)


def _upload(file: UploadFile) -> commands.Upload:
    async def save(path: Path) -> None:
        await asyncio.to_thread(_copy, file, path)

    return commands.Upload(file.filename or "", save)


def _copy(file: UploadFile, path: Path) -> None:
    with path.open("xb") as target:
        shutil.copyfileobj(file.file, target)
