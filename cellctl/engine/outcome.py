"""How a run ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from cellctl.engine.states import State
from cellctl.records import VerdictRow


@final
@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of a run: its state, the error that ended it (None where it finished), what was recorded last as verdict.

    `seconds`: of the cell's time, from connecting to the end. `moved`: a step that moves or writes was begun by this
    process. `held`: the cell has a robot, and each one's driver confirmed after the last step that it stands still.
    """

    state: State
    error: BaseException | None
    troubles: tuple[str, ...]
    verdict: VerdictRow | None
    seconds: float
    moved: bool
    held: bool


class Aborted(Exception):
    """The operator ended the run, or what started it is gone; the text says which."""


@final
class AbortedByInterlock(Aborted):
    """An interlock ended the run: a condition of a device did not hold. The command line ends with exit code 3."""
