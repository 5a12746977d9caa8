"""Puts a compensation table in force on a cell's controller: checks, push, read-back, rollback; records the change.

The change itself matters more: if the history cannot be written, the change is made and the reason is kept.

Commands and the steps of procedures push tables through this module alone.
"""

from __future__ import annotations

import asyncio
import getpass
import os
import secrets
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Self, TypeAlias, TypeVar, final

from cellctl.clock import calendar_time
from cellctl.devices import (
    ControllerTable,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    Identity,
    LimitExceeded,
    TableInfo,
    TableRow,
    TableState,
    TableStore,
)
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem, write_atomically
from cellctl.files.writing import append_line
from cellctl.formats import RobotFile, TableFile, table_problems
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.operations.cell_devices import connected, require_cells
from cellctl.operations.table_history import Action, Begin, End, Result, Seen, TableFacts, TableHistory, find_table
from cellctl.procedure.check import missing_abilities


@final
@dataclass(slots=True)
class Change:
    """A change under way. activated: the controller has confirmed it."""

    activated: bool = False


@final
class TableRecorder:
    """Records the changes that this process makes on one controller.

    run: the campaign that makes them, None: a command. who: the person, or person@host; empty: the user of this
    process. failure: why the history could not be written; empty if it was.
    """

    def __init__(self, history: TableHistory, run: str | None = None, who: str = "") -> None:
        self.history = history
        self._run = run
        self._who = who if "@" in who else user_here(who)
        self.failure = ""

    @contextmanager
    def change(
        self, action: Action, table: TableFile | str | None, replaced: str | None, reason: str = ""
    ) -> Iterator[Change]:
        """Record the begin, and the end by how this context ends; its errors pass through.

        table: to be in force afterwards, a file or the id of one that the controller has; replaced: the id before it.
        """
        table_id, facts = self._kept(table)
        name, change = secrets.token_hex(8), Change()
        begin = Begin(
            change=name,
            time=calendar_time(),
            serial=self.history.serial,
            action=action,
            who=self._who,
            run=self._run,
            table=table_id,
            replaced=replaced,
            reason=reason,
            facts=facts,
        )
        self._append(begin)
        try:
            yield change
        except BaseException as error:
            self._end(name, _result(change, error), _words(error))
            raise
        self._end(name, "in force", "")

    def seen(self, active: str | None) -> None:
        """Record which table the controller reports, if the end of the last change is uncertain."""
        with self._failures(self.history.file):
            entries, _ = self.history.read()
            if entries and entries[-1].result == "uncertain":
                self._append(Seen(time=calendar_time(), active=active))

    def _kept(self, table: TableFile | str | None) -> tuple[str | None, TableFacts | None]:
        """The id and the facts of a table; the copy of a file is written."""
        if not isinstance(table, TableFile):
            return table, self.history.facts(table)
        self._copy(table)
        return table.id, TableFacts.of(table)

    def _end(self, change: str, result: Result, reason: str) -> None:
        self._append(End(change=change, time=calendar_time(), result=result, reason=reason))

    def _append(self, line: Begin | End | Seen) -> None:
        with self._failures(self.history.file):
            self.history.folder.mkdir(parents=True, exist_ok=True)
            append_line(self.history.file, line.model_dump_json())

    def _copy(self, table: TableFile) -> None:
        file, text = self.history.copy_of(table.id), table.text()
        with self._failures(file):
            self.history.folder.mkdir(parents=True, exist_ok=True)
            if not file.exists() or file.read_bytes() != text.encode():
                write_atomically(file, text)

    @contextmanager
    def _failures(self, file: Path) -> Iterator[None]:
        """Keeps an OSError instead of raising it."""
        try:
            yield
        except OSError as error:
            cure = "free some space, or allow writing there; what happens on the controller does not depend on it"
            self.failure = f"{file}: the history of tables was not written: {error.strerror or error}\n    {cure}"


def user_here(name: str = "") -> str:
    """name@host; default: the user of this process, or the number of a user without a name, as in containers."""
    try:
        name = name or getpass.getuser()
    except (KeyError, OSError):
        name = str(os.getuid())
    return f"{name}@{socket.gethostname()}"


def _words(error: BaseException) -> str:
    return error.what if isinstance(error, DeviceError) else str(error) or f"interrupted ({type(error).__name__})"


def _result(change: Change, error: BaseException) -> Result:
    """Whether the new table is in force after `error`; a device that is lost before the activation kept the old one."""
    certain = isinstance(error, DeviceLost | DeviceRefused | LimitExceeded) and not isinstance(error, DeviceUncertain)
    if not certain:
        return "uncertain"
    return "in force" if change.activated else "not in force"


_SHOWN = 5

_Before: TypeAlias = Callable[[], Awaitable[None]]


async def _nothing() -> None:
    """No action before the push."""


def controller_table(table: TableFile) -> ControllerTable:
    """`table` in the controller's form."""
    return ControllerTable(table.id, table.robot.serial, tuple(TableRow(*pair) for pair in table.pairs()))


def refuse_table(
    table: TableFile,
    file: Path,
    identity: Identity,
    robot: RobotFile,
    correction_deg: float,
    *,
    made: str | None = None,
) -> None:
    """Raise InputError with every reason why `table`, of `file`, must not go to the controller `identity` of `robot`.

    correction_deg: the largest allowed correction of a joint; made: the id that it must have, None: any.
    """
    serial, simulated = identity.serial, identity.simulated
    found = table_problems(table, serial=serial, simulated=simulated, robot=robot, correction_deg=correction_deg)
    if made is not None and made != table.id:
        found.insert(0, f"it is table {table.id[:12]}…, this run made {made[:12]}…")
    if found:
        raise InputError(Problem(str(file), 0, 0, f"is not pushed: {what}") for what in found)


async def push_verified(
    store: TableStore, table: TableFile, recorder: TableRecorder, action: Action = "push", before: _Before = _nothing
) -> None:
    """Activate `table` on the recorder's controller, read the active table and compare it, digit by digit.

    A table that is already active is not pushed again, as a rollback would then restore the same table.
    `before` is awaited before a push. The change is recorded as `action`. Raises DeviceFault if another table is active
    afterwards, DeviceLost if the connection ends after the push, and the store's errors.
    """
    state = await store.table_state()
    if in_force(state, table.id) and not state.staged:
        recorder.seen(table.id)
        await _read_back(store, table, recorder.history.serial)
        return
    await before()
    with recorder.change(action, table, active_id(state)) as change:
        await store.push_table(controller_table(table))
        change.activated = True
        await _read_back(store, table, recorder.history.serial)


async def roll_back(
    store: TableStore, state: TableState, recorder: TableRecorder, action: Action = "rollback", reason: str = ""
) -> TableState:
    """Activate the previous table of the controller, which is in `state`; returns the state afterwards.

    The change is recorded as `action`. Raises DeviceFault if the same table is active afterwards, and the store's
    errors.
    """
    if state.active is None and state.previous is None:
        return await store.rollback_table()  # it refuses; there is no change to record
    with recorder.change(action, state.previous.id if state.previous else None, active_id(state), reason):
        after = await store.rollback_table()
        if active_id(after) == active_id(state):
            raise DeviceFault(store.name, "it was pushed twice and is still in force after one rollback")
    return after


async def _read_back(store: TableStore, table: TableFile, serial: str) -> None:
    try:
        found = await store.read_table()
    except DeviceLost as error:
        what = f"table {table.id[:12]} is in force, but the connection was lost as it was read once more: {error.what}"
        raise DeviceLost(store.name, what, "look with `cellctl table verify`") from error
    if wrong := differences(controller_table(table), serial, found):
        what = f"after the push another table is in force than was pushed: {'; '.join(wrong)}"
        raise DeviceFault(store.name, what, "look with `cellctl table show`; `cellctl table rollback` undoes it")


def active_id(state: TableState) -> str | None:
    """The id of the controller's active table; None without one."""
    return state.active.id if state.active else None


def in_force(state: TableState, table_id: str) -> bool:
    """Whether the controller's active table is the one with this id."""
    return active_id(state) == table_id


def differences(wanted: ControllerTable, serial: str, found: ControllerTable | None) -> list[str]:
    """The difference of the active table on controller `serial` from `wanted`, as text; empty: all digits are equal."""
    if found is None:
        return ["no table is in force"]
    listed = []
    if wanted.serial != serial:
        listed.append(f"the file is for controller '{wanted.serial}', this one is '{serial}'")
    if wanted.id != found.id:
        listed.append(f"the one in force is {found.id[:12]}, the file's is {wanted.id[:12]}")
    if len(wanted.rows) != len(found.rows):
        listed.append(f"the one in force has {len(found.rows)} rows, the file's has {len(wanted.rows)}")
    pairs = enumerate(zip(wanted.rows, found.rows, strict=False), 1)
    rows = [number for number, (ours, theirs) in pairs if _digits(ours) != _digits(theirs)]
    if rows:
        more = f" and {len(rows) - _SHOWN} more" if len(rows) > _SHOWN else ""
        listed.append(f"other joints in row {', '.join(map(str, rows[:_SHOWN]))}{more}")
    return listed


def _digits(row: TableRow) -> tuple[str, ...]:
    """A row in wire format."""
    return tuple(f"{value + 0.0:.{JOINT_DECIMALS}f}" for value in (*row.nominal, *row.compensated))


Answer = TypeVar("Answer")


@final
@dataclass(frozen=True)
class TableCell:
    """A cell with one device that stores tables; seed and memory are for its simulators."""

    cell: Cell
    robot: RobotFile
    drivers: DriverRegistry
    device: str
    seed: int | None
    state: Path | None

    @classmethod
    def load(cls, path: Path, seed: int | None, state: Path | None) -> Self:
        """Read and check the cell file; opens nothing. Raises InputError."""
        require_cells()
        drivers = DriverRegistry()
        cell = Cell.load(path, drivers)
        if state is not None and not cell.simulated:
            raise InputError(
                Problem("--state", 0, 0, "is a simulated cell's memory; this cell is real", "leave it out")
            )
        robot = RobotFile.load(cell.robot_file)
        robot.refuse_prismatic(str(cell.robot_file), "a compensation table")
        return cls(cell, robot, drivers, _table_keeper(cell, drivers), seed, state)

    def carry_out(self, work: Callable[[TableStore, Identity], Awaitable[Answer]]) -> Answer:
        """The result of `work` on the connected device and its identity. Raises what it raises, and DeviceError."""

        async def go() -> Answer:
            async with self.connected() as (store, identity):
                return await work(store, identity)

        return asyncio.run(go())

    @asynccontextmanager
    async def connected(self) -> AsyncIterator[tuple[TableStore, Identity]]:
        """The device, connected alone, and its identity."""
        extra = ("--state", str(self.state)) if self.state else ()
        async with connected(self.cell, self.drivers, [self.device], seed=self.seed, extra=extra) as devices:
            found = devices[self.device]
            yield found.device, found.identity


@final
@dataclass(frozen=True, slots=True)
class Pushed:
    """A table that was pushed and read back. recorded: whether the history could be written."""

    id: str
    serial: str
    rows: int
    pushed: bool
    verified: bool
    active: bool
    recorded: bool


@final
@dataclass(frozen=True, slots=True)
class RolledBack:
    """The tables of a controller after a rollback. recorded: whether the history could be written."""

    serial: str
    active: TableInfo | None
    previous: TableInfo | None
    staged: TableInfo | None
    recorded: bool


@final
@dataclass(frozen=True, slots=True)
class Verified:
    """The table in force, compared with a file. differences: as text; empty: all digits are equal."""

    id: str
    serial: str
    rows: int
    same: bool
    differences: list[str]


async def push_checked(
    store: TableStore,
    identity: Identity,
    table: TableFile,
    file: Path,
    place: TableCell,
    recorder: TableRecorder,
    action: Action = "push",
) -> Pushed:
    """Push `table`, of `file`, to the connected controller `identity`, and read it back after its activation.

    Raises InputError with every reason against this controller (nothing is written then), DeviceError.
    """
    refuse_table(table, file, identity, place.robot, place.cell.table_correction_deg)
    await push_verified(store, table, recorder, action)
    return Pushed(
        id=table.id,
        serial=identity.serial,
        rows=len(table.rows),
        pushed=True,
        verified=True,
        active=True,
        recorded=not recorder.failure,
    )


async def push_recorded(
    store: TableStore, identity: Identity, word: str, place: TableCell, recorder: TableRecorder
) -> Pushed:
    """`push_checked`, as a rollback, of the table in the recorder's history whose id begins with `word`.

    Raises InputError if there is none or more than one, or its copy has changed; and what `push_checked` raises.
    """
    history, table_id = find_table(word, [recorder.history])
    table = history.table(table_id)
    return await push_checked(store, identity, table, history.copy_of(table_id), place, recorder, "rollback")


async def rolled_back(store: TableStore, serial: str, state: TableState, recorder: TableRecorder) -> RolledBack:
    """The tables of the controller `serial`, in `state` before, after `roll_back`."""
    after = await roll_back(store, state, recorder)
    return RolledBack(serial, after.active, after.previous, after.staged, not recorder.failure)


async def verified(store: TableStore, serial: str, wanted: ControllerTable) -> Verified:
    """The table in force on the controller `serial`, compared with `wanted`."""
    found = differences(wanted, serial, await store.read_table())
    return Verified(wanted.id, serial, len(wanted.rows), not found, found)


def _table_keeper(cell: Cell, drivers: DriverRegistry) -> str:
    """The only device of the cell that stores tables. Raises InputError."""
    kinds = {name: drivers.abilities(address.scheme) for name, address in cell.addresses.items()}
    names = [name for name, kind in kinds.items() if not missing_abilities(kind, TableStore)]
    if len(names) == 1:
        return names[0]
    what = (
        "has no device that keeps tables" if not names else f"has more than one that keeps tables: {', '.join(names)}"
    )
    raise InputError(cell.document.problem((), what, "one robot whose driver can push tables"))
