"""The engine's states and the one table of how they follow each other."""

from __future__ import annotations

from enum import StrEnum
from typing import final


@final
class State(StrEnum):
    """Where a run is. Finished, aborted, failed and uncertain are ends; uncertain needs a person."""

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
    """The engine tried to go from one state to another that the table does not allow: an error of ours."""


def checked(current: State, following: State) -> State:
    """`following`, where the table allows it after `current`. Raises IllegalTransition."""
    if following not in TRANSITIONS[current]:
        raise IllegalTransition(f"{current} → {following}")
    return following
