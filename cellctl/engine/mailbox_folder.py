"""Actions from other processes: one file each in the run's `mailbox/`, written whole and deleted when it is taken.

Files need neither port nor signal: this works on every system and over a shared folder.
"""

from __future__ import annotations

import asyncio
import json
import secrets
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, cast, final, get_args

from cellctl.clock import calendar_time
from cellctl.engine.mailbox import Action, ActionName, Mailbox, Operator
from cellctl.engine.waiting import beside
from cellctl.files import write_atomically

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

    @asynccontextmanager
    async def emptied_into(self, mailbox: Mailbox) -> AsyncIterator[None]:
        """Inside this context, pass each action to `mailbox`; actions that were waiting before are deleted."""
        self._take()
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
