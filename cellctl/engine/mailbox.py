"""What operators ask of a running campaign, on its way to the engine."""

from __future__ import annotations

import getpass
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Self, final

ActionName = Literal["pause", "resume", "abort", "confirm"]


@final
@dataclass(frozen=True, slots=True)
class Operator:
    """Who acts: a user, on a host, by means of `via` (`cli`, `terminal`, `SIGINT`, `console`)."""

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
    """One thing that an operator asks for. `text`: the reason; `id`: of the file that brought it, empty without one."""

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
        """Go on after a pause."""
        self.post(Action("resume", operator or Operator.here("program")))

    def abort(self, why: str = "aborted by the operator", operator: Operator | None = None) -> None:
        """End the campaign: cancel what runs, clean up; `why`, for who reads of it. A second abort changes nothing."""
        self.post(Action("abort", operator or Operator.here("program"), why))

    def confirm(self, operator: Operator | None = None) -> None:
        """Confirm what the run waits for."""
        self.post(Action("confirm", operator or Operator.here("program")))

    def post(self, action: Action) -> None:
        """Hand an action to the engine, or keep it until one asks."""
        if self._take:
            self._take(action)
        else:
            self._waiting.append(action)

    def taken_by(self, take: Callable[[Action], object]) -> None:
        """From here on `take` gets every action; those that waited, at once."""
        self._take = take
        waiting, self._waiting = self._waiting, []
        for action in waiting:
            take(action)
