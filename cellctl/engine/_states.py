"""The engine's states, the table of allowed transitions, and how a run ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import final

from cellctl.records import VerdictRow


@final
class State(StrEnum):
    """State of a run. Finished, aborted, failed and uncertain are final; uncertain requires a person's check.

    Checking lasts for an instant: procedure and cell are checked before there is an engine.
    """

    IDLE = "idle"
    CHECKING = "checking"
    CONNECTING = "connecting"
    RUNNING = "running"
    PAUSED = "paused"
    CLEANING = "cleaning"
    FINISHED = "finished"
    ABORTED = "aborted"
    FAILED = "failed"
    UNCERTAIN = "uncertain"


ENDS = frozenset({State.FINISHED, State.ABORTED, State.FAILED, State.UNCERTAIN})

TRANSITIONS: dict[State, frozenset[State]] = {
    State.IDLE: frozenset({State.CHECKING}),
    State.CHECKING: frozenset({State.CONNECTING, State.CLEANING}),
    State.CONNECTING: frozenset({State.RUNNING, State.CLEANING}),
    State.RUNNING: frozenset({State.PAUSED, State.CLEANING}),
    State.PAUSED: frozenset({State.RUNNING, State.CLEANING}),
    State.CLEANING: frozenset({State.FINISHED, State.ABORTED, State.FAILED, State.UNCERTAIN}),
    State.FINISHED: frozenset(),
    State.ABORTED: frozenset(),
    State.FAILED: frozenset(),
    State.UNCERTAIN: frozenset(),
}


class IllegalTransition(RuntimeError):
    """The engine attempted a transition that the table does not allow: an internal error."""


def checked(current: State, following: State) -> State:
    """`following`, if the table allows it after `current`. Raises IllegalTransition."""
    if following not in TRANSITIONS[current]:
        raise IllegalTransition(f"{current} → {following}")
    return following


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
