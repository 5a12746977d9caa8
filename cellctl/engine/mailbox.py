"""Operators' actions on a running campaign, queued for the engine."""

from __future__ import annotations

import getpass
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Self, final

ActionName = Literal["pause", "resume", "abort", "confirm", "reset"]


@final
@dataclass(frozen=True, slots=True)
class Operator:
    """An operator: a user on a host, and the interface used, `via` (`cli`, `terminal`, `SIGINT`, `console`)."""

    name: str
    host: str
    via: str

    @classmethod
    def here(cls, via: str) -> Self:
        """The user of this process."""
        return cls(getpass.getuser(), socket.gethostname(), via)


@final
@dataclass(frozen=True, slots=True)
class Action:
    """One action that an operator requests. `id`: of the file that brought it, else empty.

    `text`: the reason; of `confirm` the path of the step that is confirmed, empty for the one that waits.
    """

    name: ActionName
    operator: Operator
    text: str = ""
    id: str = ""


@final
class Mailbox:
    """Takes operators' actions for the engine. Use it from the engine's loop and its signal handlers.

    Actions wait until an engine takes them. `confirm_all`: every `confirm` step is confirmed at once, by this operator.
    """

    def __init__(self, confirm_all: Operator | None = None) -> None:
        self.confirm_all = confirm_all
        self._waiting: list[Action] = []
        self._take: Callable[[Action], object] | None = None

    def pause(self, operator: Operator | None = None) -> None:
        """Stop before the next step."""
        self.post(Action("pause", operator or Operator.here("program")))

    def resume(self, operator: Operator | None = None) -> None:
        """Continue after a pause."""
        self.post(Action("resume", operator or Operator.here("program")))

    def abort(self, why: str = "aborted by the operator", operator: Operator | None = None) -> None:
        """End the campaign: cancel the work and clean up. `why`: the recorded reason. A second abort has no effect."""
        self.post(Action("abort", operator or Operator.here("program"), why))

    def confirm(self, operator: Operator | None = None, step: str = "") -> None:
        """Confirm the step that the run waits for; with `step`, only if it is the one at this path."""
        self.post(Action("confirm", operator or Operator.here("program"), step))

    def post(self, action: Action) -> None:
        """Pass an action to the engine, or keep it until an engine takes it."""
        if self._take:
            self._take(action)
        else:
            self._waiting.append(action)

    def taken_by(self, take: Callable[[Action], object]) -> None:
        """Pass every action to `take` from now on; waiting ones at once."""
        self._take = take
        waiting, self._waiting = self._waiting, []
        for action in waiting:
            take(action)
