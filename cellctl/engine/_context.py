"""What the engine is given, a procedure that is ready to run; and what it gives to a step."""

from __future__ import annotations

import pathlib
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from cellctl.clock import Clock
from cellctl.devices import Device, Identity
from cellctl.files import Document, InputError, Problem, sha256_of, write_atomically
from cellctl.journal import KnownEvent, Recorded, RunState, Said
from cellctl.procedure import Procedure, StepRegistry
from cellctl.records import AnyRow, ArtefactRow, Row


@final
@dataclass(slots=True)
class Plan:
    """The procedure with its parameters' values, the step kinds, and the devices by name."""

    procedure: Procedure
    parameters: Mapping[str, Any]
    registry: StepRegistry
    devices: dict[str, Device]


@final
@dataclass(slots=True)
class Surround:
    """The data that all steps of a run share.

    recomputed: the run's files are made again by a replay, and may differ from the recorded ones.
    """

    clock: Clock
    seed: int
    run_folder: pathlib.Path
    cell: Document
    robot_file: pathlib.Path
    devices: Mapping[str, Device]
    recomputed: bool = False


@final
@dataclass(slots=True)
class Context:
    """One attempt at one step: implements `cellctl.procedure.StepContext`.

    journal: its state so far; append: commits an event to it.
    """

    step: str
    attempt: int
    run: Surround
    needs: frozenset[str]
    journal: RunState
    append: Callable[[KnownEvent], None]
    uses: frozenset[str] = frozenset()

    @property
    def clock(self) -> Clock:
        """The cell's time."""
        return self.run.clock

    @property
    def runs(self) -> pathlib.Path:
        """The folder of the runs."""
        return self.run.run_folder.parent

    @property
    def seed(self) -> int:
        """The run's seed."""
        return self.run.seed

    @property
    def run_folder(self) -> pathlib.Path:
        """Where the run's files are."""
        return self.run.run_folder

    @property
    def run_name(self) -> str:
        """The run's name at its start, also after its folder moved."""
        return self.journal.name or self.run.run_folder.name

    @property
    def operator(self) -> str:
        """The person who started the run or resumed it last."""
        return self.journal.operator

    @property
    def calendar(self) -> str:
        """When the run began or was last resumed, UTC, ISO 8601."""
        return self.journal.calendar

    @property
    def cell(self) -> Document:
        """The cell file."""
        return self.run.cell

    @property
    def robot_file(self) -> pathlib.Path:
        """The robot file that the cell names."""
        return self.run.robot_file

    def device(self, name: str) -> Any:
        """A connected device that the step declared in `needs` or `uses`. Raises KeyError."""
        if name not in self.needs | self.uses:
            raise KeyError(f"step {self.step} does not declare that it needs '{name}'")
        return self.run.devices[name]

    def optional_device(self, name: str) -> Any | None:
        """A connected device that the step declared in `uses`; None if the cell has none of that name."""
        if name not in self.uses:
            raise KeyError(f"step {self.step} does not declare that it uses '{name}'")
        return self.run.devices.get(name)

    def identity(self, name: str) -> Identity:
        """The identity that device `name` reported. Raises InputError if the run has not connected it."""
        identity = self.journal.identities.get(name)
        if identity is None:
            what = f"step {self.step} asks who '{name}' is, and the cell has no such device"
            raise InputError(Problem(self.run.cell.file, 0, 0, what, f"add '{name}' to the cell file"))
        return Identity(**identity)

    async def record(self, row: Row) -> None:
        """Commit a row; once this returns, the row survives a crash."""
        self.append(Recorded.of(row, self.step, self.attempt))

    async def write_artefact(self, name: str, content: str | bytes) -> str:
        """Write a file into the run folder, whole or not at all, and record its hash; the SHA-256 (hex)."""
        data = content.encode() if isinstance(content, str) else content
        write_atomically(self.run_folder / name, data)
        row = ArtefactRow(name, sha256_of(data), len(data))
        await self.record(row)
        return row.sha256

    def artefact(self, name: str) -> pathlib.Path:
        """A file that this run wrote into its folder. Raises InputError if it is no longer as it was written."""
        path = self.run_folder / name
        written = [row.sha256 for row in self.recorded(ArtefactRow) if row.name == name]
        if not (written and path.is_file()):
            what = "is not there"
        elif self.run.recomputed or sha256_of(path.read_bytes()) == written[-1]:
            return path
        else:
            what = "has changed since this run wrote it"
        raise InputError(Problem(str(path), 0, 0, what, "put the run's own file back, or begin a new run"))

    def recorded(self, kind: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of this class that count: of finished steps and of this attempt, in the order of recording."""
        return self.journal.recorded(kind)

    def all_recorded(self, *kinds: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of these classes of every attempt, failed and interrupted ones included, in order."""
        return self.journal.all_recorded(*kinds)

    def say(self, text: str) -> None:
        """One line of progress for the operator."""
        self.append(Said(text, self.step))


AfterConnect = Callable[[], Awaitable[None]]
