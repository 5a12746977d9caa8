"""The engine's states and the table of allowed transitions."""

from __future__ import annotations

from enum import StrEnum
from typing import final


@final
class State(StrEnum):
    """State of a run. Finished, aborted, failed and uncertain are final; uncertain requires a person's check."""

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
