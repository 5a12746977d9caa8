"""What the engine gives to a step."""

from __future__ import annotations

import pathlib
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from cellctl.clock import Clock
from cellctl.devices import Device
from cellctl.files import Document

Row = Mapping[str, Any]


@final
@dataclass(slots=True)
class Surround:
    """What is the same for every step of a run."""

    clock: Clock
    seed: int
    run_folder: pathlib.Path
    cell: Document
    robot_file: pathlib.Path
    devices: Mapping[str, Device]


@final
@dataclass(slots=True)
class Context:
    """One attempt at one step: implements `cellctl.procedure.StepContext`."""

    step: str
    attempt: int
    run: Surround
    needs: frozenset[str]
    commit: Callable[[str, Row], None]
    tell: Callable[[str], None]
    rows: Callable[[str], Sequence[Row]]
    all_rows: Callable[..., Sequence[Row]]

    @property
    def clock(self) -> Clock:
        """The cell's time."""
        return self.run.clock

    @property
    def seed(self) -> int:
        """The run's seed."""
        return self.run.seed

    @property
    def run_folder(self) -> pathlib.Path:
        """Where the run's files go."""
        return self.run.run_folder

    @property
    def cell(self) -> Document:
        """The cell file."""
        return self.run.cell

    @property
    def robot_file(self) -> pathlib.Path:
        """The robot file that the cell names."""
        return self.run.robot_file

    def device(self, name: str) -> Any:
        """A connected device that the step declared in `needs`. Raises KeyError."""
        if name not in self.needs:
            raise KeyError(f"step {self.step} did not say that it needs '{name}'")
        return self.run.devices[name]

    async def record(self, kind: str, data: Row) -> None:
        """Commit a row; when this returns it survives a crash."""
        self.commit(kind, data)

    def recorded(self, kind: str) -> Sequence[Row]:
        """The rows of `kind` that count: of finished steps and of this attempt, in the order of recording."""
        return self.rows(kind)

    def all_recorded(self, *kinds: str) -> Sequence[Row]:
        """The rows of these kinds of every attempt, failed and cut-off ones too, in order: what was done."""
        return self.all_rows(*kinds)

    def say(self, text: str) -> None:
        """One line of progress for the operator."""
        self.tell(text)


AfterConnect = Callable[[], Awaitable[None]]
