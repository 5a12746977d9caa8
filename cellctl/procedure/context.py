"""What a step is given to work with."""

from __future__ import annotations

import pathlib
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from cellctl.clock import Clock
from cellctl.files import Document

Row = Mapping[str, Any]
"""A recorded row: JSON, no NaN."""


class StepContext(Protocol):
    """The engine's side of a step: devices, time, the run so far, and the journal."""

    @property
    def step(self) -> str:
        """The step's identity, `points[17].touch`."""

    @property
    def attempt(self) -> int:
        """Which attempt this is, from 1; a resumed run goes on counting."""

    @property
    def clock(self) -> Clock:
        """The cell's time."""

    @property
    def seed(self) -> int:
        """The run's seed; all that is random in a step follows from it and the step's identity."""

    @property
    def run_folder(self) -> pathlib.Path:
        """Where the run's files go."""

    @property
    def cell(self) -> Document:
        """The cell file, with the places of its values; paths in it are relative to its folder."""

    @property
    def robot_file(self) -> pathlib.Path:
        """The robot file that the cell names."""

    def device(self, name: str) -> Any:
        """The connected device of that name: `robot: SearchingRobot = context.device("robot")`.

        A step gets what it declared in `needs`; KeyError for anything else.
        """

    async def record(self, kind: str, data: Row) -> None:
        """Commit a row of `kind` to the journal; when this returns it survives a crash.

        Raises ValueError for what JSON cannot hold (NaN among it), and the journal's own error where it cannot write.
        """

    def recorded(self, kind: str) -> Sequence[Row]:
        """The rows of `kind` that count: those of finished steps, and of this attempt, in the order of recording."""

    def all_recorded(self, *kinds: str) -> Sequence[Row]:
        """The rows of these kinds of every attempt, failed and cut-off ones too, in order: what was done."""

    def say(self, text: str) -> None:
        """One line of progress for the operator."""
