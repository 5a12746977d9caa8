"""What a form for a run needs: procedures and cells by name, parameters with limits, errors at their line."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, final

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem, load_yaml
from cellctl.installed import first_procedure, shipped
from cellctl.operations.campaign import load_campaign
from cellctl.operations.results import as_json, from_json
from cellctl.operations.worker import OperationFailed, Tell, result_of
from cellctl.procedure import (
    Confirm,
    Parameter,
    Procedure,
    Step,
    StepRegistry,
    load_procedure,
    resolve_parameters,
    walk,
)
from cellctl.procedure.check import lacking

_OWN_FOLDERS = (".", "procedures", "cells")
"""Folders below the working folder in which a user's own procedures and cells are found."""

_FIRST_KEY = {"procedure": re.compile(r"^procedure:", re.MULTILINE), "cell": re.compile(r"^devices:", re.MULTILINE)}


@final
@dataclass(frozen=True, slots=True)
class FileChoice:
    """A procedure or cell to choose. `title`: its description; `shipped`: it comes with cellctl.

    `cell`: a procedure's default cell, empty for none; `simulated`: of a cell, None for a procedure;
    `calibration_days`: after so many a cell's calibration is due, None if the file does not state it.
    """

    name: str
    file: Path
    title: str
    shipped: bool
    cell: str = ""
    simulated: bool | None = None
    calibration_days: float | None = None


@final
@dataclass(frozen=True, slots=True)
class ProcedureForm:
    """A procedure to fill in: its parameters, the texts that an operator confirms, its errors, its text by line."""

    name: str
    title: str
    file: Path
    cell: Path | None
    parameters: Mapping[str, Parameter]
    confirms: tuple[str, ...]
    problems: tuple[Problem, ...]
    lines: tuple[str, ...]


@final
@dataclass(frozen=True, slots=True)
class Checked:
    """Errors and warnings of procedure, cell and settings. `cell`: its name, and `devices`, if there is no error."""

    problems: tuple[Problem, ...]
    warnings: tuple[Problem, ...] = ()
    cell: str = ""
    devices: tuple[str, ...] = ()


def choices(kind: Literal["procedure", "cell"], named: Path | None = None) -> dict[str, FileChoice]:
    """The procedures or cells to choose by name: `named`, the user's own below the working folder, the shipped ones.

    An unreadable file is listed with its first error as the title.
    """
    own = {file.stem: file for folder in _OWN_FOLDERS for file in sorted(Path(folder).glob("*.yaml"))}
    files = {**({named.stem: named} if named else {}), **{name: file for name, file in own.items() if _is(kind, file)}}
    found = {name: _choice(kind, name, file, shipped=False) for name, file in files.items()}
    for name, file in shipped(kind).items():
        if name not in found or file.samefile(found[name].file):
            found[name] = _choice(kind, name, file, shipped=True)
    return found


def first_choice(procedures: Mapping[str, FileChoice], cell: str) -> FileChoice:
    """The procedure to offer first for the cell of this name: the first one that names it, else that of `Campaigns`."""
    fitting = [one for one in procedures.values() if cell and one.cell == cell]
    return next(iter(fitting), procedures.get(first_procedure()) or next(iter(procedures.values())))


def missing_devices(procedure: Path, cell: Path) -> tuple[str, ...]:
    """What the steps of `procedure` need that the devices of `cell` lack, each once. Raises InputError."""
    registry, drivers = StepRegistry.installed(), DriverRegistry()
    loaded = Cell.load(cell, drivers)
    kinds = {name: drivers.abilities(address.scheme) for name, address in loaded.addresses.items()}
    found: dict[str, str] = {}
    for action in load_procedure(procedure).actions():
        needs = registry.find(action.do).needs if isinstance(action, Step) else {}
        for name, protocol in needs.items():
            if what := lacking(name, protocol, kinds):
                found.setdefault(name, what)
    return tuple(found.values())


def form_of(file: Path) -> ProcedureForm:
    """The form of a procedure file. Raises InputError if it is not readable YAML."""
    procedure = load_procedure(file)
    return ProcedureForm(
        procedure.name,
        procedure.title,
        file,
        procedure.cell,
        procedure.parameters,
        tuple(action.text for action in walk(procedure.steps) if isinstance(action, Confirm)),
        procedure.problems,
        tuple(procedure.text.splitlines()),
    )


def setting_problem(procedure: Procedure, name: str, text: str) -> Problem | None:
    """The error of `text` for the parameter `name`; None if it is valid."""
    try:
        resolve_parameters(procedure, [f"{name}={text}"])
    except InputError as error:
        mine = [problem for problem in error.problems if problem.file.startswith(f"--set {name}=")]
        return mine[0] if mine else None
    return None


def checked(procedure: Path, cell: Path | None, settings: Sequence[str], runs: Path = Path("runs")) -> Checked:
    """All errors of a procedure with its cell and settings. It opens no device, and nothing moves."""
    try:
        campaign = load_campaign(procedure, cell, list(settings), runs=runs)
    except InputError as error:
        return Checked(tuple(error.problems))
    return Checked((), campaign.cell.warnings, campaign.cell.name, tuple(sorted(campaign.cell.addresses)))


async def check(procedure: Path, cell: Path | None, settings: Sequence[str], runs: Path = Path("runs")) -> Checked:
    """As `checked`, in a process of its own: it tries what the steps would refuse, which takes seconds."""
    request = {"procedure": str(procedure), "cell": str(cell or ""), "settings": list(settings), "runs": str(runs)}
    try:
        return from_json(Checked, await result_of("check", request))
    except OperationFailed as error:
        return Checked(error.failure.problems)


def check_requested(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """The operation of the worker: `procedure`, `cell`, `settings`, `runs` → all errors."""
    cell = Path(request["cell"]) if request["cell"] else None
    return as_json(checked(Path(request["procedure"]), cell, request["settings"], Path(request["runs"])))


def line_of(problem: Problem) -> str:
    """The line of the file that `problem` names; empty if it names none, or the file is not readable."""
    try:
        lines = Path(problem.file).read_text(encoding="utf-8").splitlines() if problem.line else []
    except (OSError, ValueError):
        return ""
    return lines[problem.line - 1] if problem.line <= len(lines) and lines else ""


def _is(kind: Literal["procedure", "cell"], file: Path) -> bool:
    try:
        return bool(_FIRST_KEY[kind].search(file.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return False


def _choice(kind: Literal["procedure", "cell"], name: str, file: Path, *, shipped: bool) -> FileChoice:
    try:
        found = file.stat()
        return _choice_of(kind, name, file, shipped, (found.st_ino, found.st_size, found.st_mtime_ns))
    except OSError as error:
        return FileChoice(name, file, error.strerror or str(error), shipped)


@lru_cache(maxsize=1000)
def _choice_of(kind: str, name: str, file: Path, shipped: bool, stamp: tuple[int, int, int]) -> FileChoice:
    """To read all files takes a second: an unchanged one (`stamp`) is read once."""
    try:
        data = load_yaml(file).data
    except InputError as error:
        return FileChoice(name, file, error.problems[0].what, shipped)
    data = data if isinstance(data, dict) else {}
    if kind == "cell":
        days = data.get("calibration_days")
        return FileChoice(
            name,
            file,
            str(data.get("name", name)),
            shipped,
            simulated="simulate" in data,
            calibration_days=float(days) if isinstance(days, int | float) else None,
        )
    cell = Path(str(data["cell"])).stem if "cell" in data else ""
    return FileChoice(name, file, str(data.get("title", name)), shipped, cell)
