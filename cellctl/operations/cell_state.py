"""State of a cell: from the run that is active on it, else from the last run on it, or a later `doctor`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, final

from cellctl.clock import calendar_time
from cellctl.devices import DeviceFault, DeviceLost, DeviceUncertain, DeviceUnreachable
from cellctl.devices.cell import Cell
from cellctl.files import InputError, Problem, write_atomically
from cellctl.journal import JournalError, RunStarted, RunState, fold, read_journal, writer_of
from cellctl.journal.journal_file import FILE_NAME
from cellctl.operations.doctor import Examination, Examined, ReportedIdentity
from cellctl.operations.results import as_json, from_json
from cellctl.operations.worker import OperationFailed, result_of

DeviceWord = Literal["in order", "failed", "not known"]

_LATEST = 50
"""Number of the latest runs among which the last one on a cell is looked for."""

_DOCTOR = "doctor"
"""Folder beside the runs with the last examination of each cell."""


@final
@dataclass(frozen=True, slots=True)
class DeviceState:
    """A device: what it is, whether it is in order and why not. `latency_ms`: None if not known; `last_error`, `cure`:
    of its last failure, empty if there is none.
    """

    name: str
    address: str
    state: DeviceWord = "not known"
    text: str = ""
    model: str = ""
    serial: str = ""
    firmware: str = ""
    latency_ms: float | None = None
    last_error: str = ""
    cure: str = ""


@final
@dataclass(frozen=True, slots=True)
class CellState:
    """A cell. `emergency_stop`, `guard`: `closed`, `open` or `not known`; `mode`: the robot's operating mode.

    `source`: where this is from: `run NAME`, `doctor`, or empty: nothing is known yet. `at`: of that, UTC: the begin of
    an active run, the end of another. `run`: the active one; empty: none.
    """

    name: str
    file: Path
    simulated: bool
    devices: tuple[DeviceState, ...]
    emergency_stop: str = "not known"
    guard: str = "not known"
    mode: str = "not known"
    source: str = ""
    at: str = ""
    run: str = ""


def cell_state(
    cell: Cell, run: tuple[str, RunState] | None, doctor: Examination | None, *, active: bool = True
) -> CellState:
    """The state of `cell`: from the name and state of the run that is active on it, or was the last one (not `active`);
    from the last `doctor` if there is no run, or none that ended after it.
    """
    listed = {device: str(address) for device, address in cell.addresses.items()}
    if run and not active and doctor and doctor.at >= _ended_at(run[1]):
        run = None
    if run:
        name, state = run
        devices = tuple(_in_run(device, address, state) for device, address in listed.items())
        inputs = [health.inputs for health in state.health.values()]
        modes = [health.mode for health in state.health.values()]
        source, at = f"run {name}", state.calendar if active else _ended_at(state)
    else:
        found = {one.name: one for one in doctor.devices} if doctor else {}
        devices = tuple(_examined(device, address, found.get(device)) for device, address in listed.items())
        inputs = [one.inputs for one in found.values()]
        modes = [one.mode for one in found.values()]
        source, at = ("doctor", doctor.at) if doctor else ("", "")
    emergency_stop, guard, mode = _safety(inputs, modes)
    return CellState(
        cell.name,
        cell.path,
        cell.simulated,
        devices,
        emergency_stop=emergency_stop,
        guard=guard,
        mode=mode,
        source=source,
        at=at,
        run=run[0] if run and active else "",
    )


def _ended_at(state: RunState) -> str:
    """When a run ended, UTC; when it began for one that was cut off, or that an older version wrote."""
    return (state.ended.calendar if state.ended else "") or state.calendar


def last_run_on(cell: Cell, runs: Path) -> tuple[str, RunState] | None:
    """Name and state of the run in `runs` that was on this cell last, if it connected to devices; None without one."""
    journals = sorted(runs.glob(f"*/{FILE_NAME}"), key=lambda journal: journal.stat().st_mtime, reverse=True)
    for journal in journals[:_LATEST]:
        with suppress(JournalError, InputError):
            if _is_of(journal, cell.document.text):
                state = fold(read_journal(journal))
                if state.health:
                    return journal.parent.name, state
    return None


def run_on(cell: Path, runs: Path) -> str:
    """The name of the run in `runs` that is active on the cell of this file; empty: none is."""
    text = _text(cell)
    for journal in sorted(runs.glob(f"*/{FILE_NAME}")):
        if writer_of(journal) and _is_of(journal, text):
            return journal.parent.name
    return ""


def is_on(state: RunState, cell_text: str) -> bool:
    """Whether a run with this state was started on the cell whose file has this text."""
    return state.started is not None and state.started.cell.text == cell_text


async def examine_cell(cell: Path, runs: Path) -> None:
    """Examine the cell's devices as `cellctl doctor` does, in another process; nothing moves; `runs` keeps the result.

    Raises InputError if a run is active on the cell, or for errors in the cell file.
    """
    if active := run_on(cell, runs):
        what = f"run {active} is active on this cell, and holds its devices"
        raise InputError(Problem(str(cell), 0, 0, what, "examine the cell when the run has ended"))
    try:
        found = from_json(Examination, await result_of("examine", {"cell": str(cell)}))
    except OperationFailed as error:
        raise InputError(error.failure.problems, error.failure.note) from error
    file = _doctor_file(found.cell, runs)
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(file, json.dumps(as_json(replace(found, at=calendar_time())), ensure_ascii=False))


def last_examination(cell: Cell, runs: Path) -> Examination | None:
    """The last examination of `cell`; None if there is none that is readable."""
    try:
        found = from_json(Examination, json.loads(_doctor_file(cell.name, runs).read_text(encoding="utf-8")))
        return found if found.at else None
    except (OSError, ValueError):
        return None


def _doctor_file(cell: str, runs: Path) -> Path:
    return runs / _DOCTOR / f"{re.sub(r'[^A-Za-z0-9_-]+', '_', cell)}.json"


def _text(cell: Path) -> str:
    try:
        return cell.read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise InputError(Problem(str(cell), 0, 0, f"cannot be read: {error}", "check the path")) from error


def _is_of(journal: Path, text: str) -> bool:
    first = next(iter(read_journal(journal)), None)
    return bool(first and isinstance(first.event, RunStarted) and first.event.cell.text == text)


_OUT_OF_ORDER = {error.__name__ for error in (DeviceUnreachable, DeviceLost, DeviceUncertain, DeviceFault)}
"""Failures after which a device counts as failed; others (no contact, target lost) are results of a measurement."""


def out_of_order(state: RunState) -> dict[str, tuple[str, str]]:
    """The devices of a run that count as failed since their last failure, each with its text and cure."""
    return {
        device: (failure.text.partition(": ")[2].partition("\n")[0], failure.cure)
        for device, failure in state.device_failures.items()
        if failure.error in _OUT_OF_ORDER
    }


def _in_run(device: str, address: str, state: RunState) -> DeviceState:
    identity, health = state.identities.get(device, {}), state.health.get(device)
    failure = state.device_failures.get(device)
    failed = device in out_of_order(state) or bool(health and not health.ok)
    return DeviceState(
        device,
        address,
        state="failed" if failed else "in order" if health else "not known",
        text=health.text if health else "",
        model=identity.get("model", ""),
        serial=identity.get("serial", ""),
        firmware=identity.get("firmware", ""),
        latency_ms=health.latency_ms if health else None,
        last_error=failure.text.partition(": ")[2].partition("\n")[0] if failure else "",
        cure=failure.cure if failure else "",
    )


def _examined(device: str, address: str, found: Examined | None) -> DeviceState:
    if found is None:
        return DeviceState(device, address)
    identity = found.identity or ReportedIdentity("", "", "", simulated=False)
    return DeviceState(
        device,
        address,
        state="in order" if found.healthy else "failed",
        text=found.health or "",
        model=identity.model,
        serial=identity.serial,
        firmware=identity.firmware,
        latency_ms=found.latency_ms,
        last_error=found.what,
        cure=found.cure,
    )


def _safety(reported: Iterable[Mapping[str, bool]], modes: Iterable[str]) -> tuple[str, str, str]:
    """Emergency stop, guard and operating mode, from the inputs that devices reported; names as of `CellIO`."""
    inputs = {name: value for each in reported for name, value in each.items()}
    chain = {True: "closed", False: "open", None: "not known"}
    key = {True: "AUTO (key switch)", False: "not AUTO (key switch)", None: "not known"}
    mode = next(filter(None, modes), "") or key[inputs.get("mode_auto")]
    return chain[inputs.get("emergency_stop_ok")], chain[inputs.get("guard_closed")], mode
