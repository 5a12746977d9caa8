"""How a run ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from cellctl.engine.states import State
from cellctl.records import VerdictRow


@final
@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of a run: its state, the error that ended it (None if it finished), the last recorded verdict.

    `seconds`: of the cell's time, from connecting to the end. `moved`: a step that moves or writes was begun in this
    process. `held`: the cell has a robot, and each one's driver confirmed standstill after the last step.
    """

    state: State
    error: BaseException | None
    troubles: tuple[str, ...]
    verdict: VerdictRow | None
    seconds: float
    moved: bool
    held: bool

    @property
    def robot(self) -> str:
        """State of the robot at the end of a run; reported as held only if this run has a confirmation."""
        if self.held:
            held = "the robot is held: its controller confirmed that it stands still"
            return held if self.moved else f"nothing was moved, and {held}"
        if not self.moved:
            return "nothing was moved"
        return "it is not confirmed that the robot stands still: look at it before anything else moves"


class Aborted(Exception):
    """The operator ended the run, or its parent process ended; the text gives the reason."""


@final
class AbortedByInterlock(Aborted):
    """An interlock ended the run: a condition of a device did not hold. The command line ends with exit code 3."""
