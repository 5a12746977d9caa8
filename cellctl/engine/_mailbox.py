"""Operators' actions on a running campaign, queued for the engine; those of other processes in `mailbox/`.

Files need neither port nor signal: this works on every system and over a shared folder.
"""

from __future__ import annotations

import asyncio
import getpass
import json
import secrets
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Self, cast, final, get_args

from cellctl.clock import calendar_time
from cellctl.engine._waiting import beside
from cellctl.files import write_atomically

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


_LOOK_EVERY_S = 0.2
"""Wall time: the cell's time may be stopped while the run waits for a person."""


@final
class MailboxFolder:
    """The folder `mailbox/` of a run folder; it exists while actions wait in it."""

    def __init__(self, run_folder: Path) -> None:
        self._folder = run_folder / "mailbox"

    def put(self, action: ActionName, operator: Operator, text: str = "") -> str:
        """Write an action for the engine; returns its id, which the journal will contain. Raises OSError."""
        self._folder.mkdir(exist_ok=True)
        number = secrets.token_hex(8)
        data = {
            "id": number,
            "action": action,
            "operator": operator.name,
            "host": operator.host,
            "via": operator.via,
            "text": text,
        }
        write_atomically(self._folder / f"{number}.json", json.dumps({**data, "written": calendar_time()}))
        return number

    def withdraw(self, number: str) -> bool:
        """Withdraw an action; returns whether it was still waiting."""
        try:
            (self._folder / f"{number}.json").unlink()
        except OSError:
            return False
        return True

    def clear(self) -> None:
        """Delete what waits: where a run is resumed, it was meant for an earlier process."""
        self._take()

    @asynccontextmanager
    async def emptied_into(self, mailbox: Mailbox) -> AsyncIterator[None]:
        """Inside this context, pass each action to `mailbox`, those that are waiting already first.

        An abort may come while devices and simulators still start.
        """
        try:
            async with beside(self._look(mailbox), "mailbox folder"):
                yield
        finally:
            self._take()
            with suppress(OSError):
                self._folder.rmdir()

    async def _look(self, mailbox: Mailbox) -> None:
        while True:
            for action in self._take():
                mailbox.post(action)
            await asyncio.sleep(_LOOK_EVERY_S)

    def _take(self) -> list[Action]:
        """The waiting actions, oldest first; deletes their files, and files without a valid action."""
        found: list[tuple[str, Action]] = []
        for path in self._folder.glob("*.json"):
            with suppress(OSError, ValueError, TypeError, KeyError, RecursionError):
                data = path.read_bytes()
                path.unlink()
                found.append(_read(json.loads(data)))
        return [action for _, action in sorted(found, key=lambda entry: entry[0])]


def _read(data: dict[str, Any]) -> tuple[str, Action]:
    """The time of writing, and the action. Raises KeyError, TypeError, ValueError."""
    name = data["action"]
    json.dumps(data, ensure_ascii=False).encode()  # the journal is UTF-8
    if name not in get_args(ActionName):
        raise ValueError(f"'{name}' is no action")
    operator = Operator(str(data["operator"]), str(data["host"]), str(data.get("via", "")))
    return str(data["written"]), Action(cast("ActionName", name), operator, str(data.get("text", "")), str(data["id"]))
