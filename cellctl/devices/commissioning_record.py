"""`commissioning.json` beside a cell file: what was measured at each step, and who confirmed it.

One file for all cells of the folder, by the cell's name; a simulated cell has a record of its own. A step is bound to
its device's identity and set-up (address, limits, the files for its controller), a step of the whole cell to all of it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, Self, final

from pydantic import TypeAdapter, ValidationError

from cellctl.clock import WallClock
from cellctl.devices._commissioning import Figure
from cellctl.devices._protocols import Identity
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem, sha256_of, write_atomically
from cellctl.installed import shipped
from cellctl.version import __version__

FILE_NAME = "commissioning.json"
FORMAT = "cellctl commissioning 1"

StepState = Literal["due", "passed", "failed", "declined"]

_BESIDE_THE_SETUP = ("simulate", "report")
"""Sections of a cell file that a step does not depend on: the cell is the same without them."""


@final
@dataclass(frozen=True)
class StepRecord:
    """A step and its result. `device`: empty for one of the whole cell; `id`: `DEVICE.STEP`, or `cell.STEP`.

    `declined`: nobody confirmed it. `what`, `cure`: of the error that ended it. `confirmed_by`, `via`: who, and how
    (`terminal`, `--yes`); `at`: UTC, when it ended. `setup`, `identity`: digests of what it is bound to.
    """

    id: str
    device: str
    title: str
    does: str
    next_needs: str
    moves: bool
    state: StepState = "due"
    figures: tuple[Figure, ...] = ()
    what: str = ""
    cure: str = ""
    confirmed_by: str = ""
    via: str = ""
    at: str = ""
    setup: str = ""
    identity: str = ""


@final
@dataclass(frozen=True)
class CellRecord:
    """The commissioning of one cell: its steps in their order. `version`: of cellctl, at the last call."""

    cell: str
    simulated: bool
    version: str = __version__
    steps: tuple[StepRecord, ...] = ()

    @property
    def state(self) -> StepState:
        """`passed` if every step is, else the state of the first that is not."""
        return next((step.state for step in self.steps if step.state != "passed"), "passed" if self.steps else "due")

    def step(self, id_: str) -> StepRecord | None:
        """The step `id_`, if the record has it."""
        return next((step for step in self.steps if step.id == id_), None)

    def with_step(self, step: StepRecord) -> Self:
        """The record with this step in place of the one with its id."""
        return replace(self, steps=tuple(step if each.id == step.id else each for each in self.steps))


@final
@dataclass(frozen=True)
class _Content:
    format: str = FORMAT
    cells: tuple[CellRecord, ...] = field(default_factory=tuple)


_CONTENT: TypeAdapter[_Content] = TypeAdapter(_Content)


def record_file(cell: Path) -> Path:
    """The record of the cell in this file: beside it; of a shipped cell in the working folder."""
    is_shipped = any(cell.resolve() == file.resolve() for file in shipped("cell").values())
    return Path(FILE_NAME) if is_shipped else cell.parent / FILE_NAME


def load_record(file: Path, cell: str, *, simulated: bool) -> CellRecord | None:
    """The record of a cell; None if there is none. Raises InputError if the file is damaged or of another format."""
    found = (each for each in _load(file).cells if (each.cell, each.simulated) == (cell, simulated))
    return next(found, None)


def save_record(file: Path, record: CellRecord) -> None:
    """Write the record in place of the cell's earlier one; those of other cells stay. Raises InputError, OSError."""
    mine = (record.cell, record.simulated)
    others = tuple(each for each in _load(file).cells if (each.cell, each.simulated) != mine)
    content = _CONTENT.dump_python(_Content(cells=(*others, record)), mode="json")
    write_atomically(file, json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def _load(file: Path) -> _Content:
    try:
        content: Any = json.loads(file.read_text(encoding="utf-8"))
        stated = content.get("format") if isinstance(content, dict) else None
        if stated != FORMAT:
            raise ValueError(f"its format is '{stated}', and '{FORMAT}' is known here")
        return _CONTENT.validate_python(content)
    except FileNotFoundError:
        return _Content()
    except OSError as error:
        raise InputError(Problem(str(file), 0, 0, f"cannot be read: {error.strerror}", "check the path")) from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        what = f"{'.'.join(map(str, first['loc']))}: {first['msg']}"
    except ValueError as error:  # not JSON, or of another format
        what = str(error)
    cure = "move the file away, and commission the cell again"
    raise InputError(Problem(str(file), 0, 0, f"is no record of a commissioning: {what}", cure))


def setup_digest(cell: Cell, drivers: DriverRegistry, device: str = "") -> str:
    """SHA-256 of what a step of `device` depends on in the cell's files; without a device, of all of it."""
    if not device:
        data = {key: value for key, value in cell.document.data.items() if key not in _BESIDE_THE_SETUP}
        parts = [setup_digest(cell, drivers, name) for name in sorted(cell.addresses)]
        return sha256_of({"cell": data, "robot": sha256_of(cell.robot_file.read_bytes()), "devices": parts})
    address = cell.addresses[device]
    files = drivers.controller_files(cell.name, address, cell.surroundings(device, WallClock())) or {}
    return sha256_of({"address": str(address), "limits": cell.limits.get(device, {}), "files": files})


def identity_digest(identities: Iterable[Identity]) -> str:
    """SHA-256 of what devices report of themselves."""
    listed = sorted((each.device, each.serial, each.model, each.firmware, each.simulated) for each in identities)
    return sha256_of([list(map(str, each)) for each in listed])


def commissioning_warnings(cell: Cell, drivers: DriverRegistry) -> list[Problem]:
    """A warning if a real cell has no record of its commissioning, or one that is out of date. Opens no device."""
    if cell.simulated:
        return []
    file, cure = record_file(cell.path), f"cellctl doctor {cell.path} --commission"
    try:
        record = load_record(file, cell.name, simulated=False)
    except InputError as error:
        return error.problems
    if record is None:
        return [cell.document.problem(("name",), f"'{cell.name}' has no record of a commissioning in {file}", cure)]
    changed = [each.id for each in record.steps if each.setup and each.setup != _now(cell, drivers, each)]
    if changed:
        what = f"'{cell.name}' has changed since its commissioning ({file}): due again are {', '.join(changed)}"
        return [cell.document.problem(("name",), what, cure)]
    if left := [each.id for each in record.steps if each.state != "passed"]:
        what = f"the commissioning of '{cell.name}' ({file}) is not complete: {', '.join(left)}"
        return [cell.document.problem(("name",), what, cure)]
    return []


def _now(cell: Cell, drivers: DriverRegistry, step: StepRecord) -> str:
    """The set-up's digest of a step; of a device that the cell no longer has, none."""
    return setup_digest(cell, drivers, step.device) if not step.device or step.device in cell.addresses else ""
