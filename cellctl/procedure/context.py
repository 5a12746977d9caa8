"""The interface through which a step works."""

from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any, Protocol

from cellctl.clock import Clock
from cellctl.devices import Identity
from cellctl.files import Document
from cellctl.records import AnyRow, Row


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
    def runs(self) -> pathlib.Path:
        """The folder of the runs."""

    @property
    def run_folder(self) -> pathlib.Path:
        """Where the run's files are. To write one: `write_artefact`; to read one: `artefact`."""

    @property
    def run_name(self) -> str:
        """The run's name at its start, also after its folder moved."""

    @property
    def operator(self) -> str:
        """The person who started the run or resumed it last."""

    @property
    def calendar(self) -> str:
        """When the run began or was last resumed, UTC, ISO 8601: a label, from the journal."""

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

    def optional_device(self, name: str) -> Any | None:
        """The connected device of that name that the step declared in `uses`; None if the cell has none.

        KeyError for anything else.
        """

    def identity(self, name: str) -> Identity:
        """The identity that device `name` reported when this run connected it. Needs no device. Raises InputError."""

    async def record(self, row: Row) -> None:
        """Commit a row to the journal; once this returns, the row survives a crash.

        Raises ValueError for values outside JSON (NaN included), and the journal's error if it cannot write.
        """

    async def write_artefact(self, name: str, content: str | bytes) -> str:
        """Write a file into the run folder, whole or not at all, and record its hash; the SHA-256 (hex).

        Raises OSError, and what `record` raises.
        """

    def artefact(self, name: str) -> pathlib.Path:
        """A file that this run wrote with `write_artefact`, to be read.

        Raises InputError if it is missing, or not as this run wrote it.
        """

    def recorded(self, kind: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of this class that count: those of finished steps, and of this attempt, in the order of recording.

        Raises InputError, naming event, kind and field, if the journal's data do not fit the class.
        """

    def all_recorded(self, *kinds: type[AnyRow]) -> Sequence[AnyRow]:
        """The rows of these classes of every attempt, failed and interrupted ones included, in order."""

    def say(self, text: str) -> None:
        """One line of progress for the operator."""
