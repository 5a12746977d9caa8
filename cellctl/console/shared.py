"""What pages and API share: one `Console` for each process, and the audit log of its commands."""

from __future__ import annotations

import asyncio
import secrets
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, final

from cellctl.clock import calendar_time
from cellctl.console.jobs import Jobs
from cellctl.console.live import LiveRuns
from cellctl.console.sessions import IDLE_MIN, Sessions
from cellctl.console.watching import Watch
from cellctl.console.webhook import Webhook
from cellctl.engine import Operator
from cellctl.files.json_lines import JsonLines

FILE_NAME = "audit.jsonl"


@final
@dataclass(frozen=True, slots=True)
class Audit:
    """The file `audit.jsonl` of a folder of runs: one JSON object for each line, two lines for each command.

    The first line is durable before the command begins, the second states its outcome: a command without a second
    line was cut off.
    """

    folder: Path

    def asked(self, operator: Operator, command: str, target: str, details: dict[str, Any]) -> str:
        """Record that `operator` gave `command` for `target` (a run, a cell, a table); its id. Raises OSError."""
        number = secrets.token_hex(8)
        self._append(
            {
                "id": number,
                "time": calendar_time(),
                "command": command,
                "target": target,
                "operator": operator.name,
                "host": operator.host,
                "via": operator.via,
                **({"details": details} if details else {}),
            }
        )
        return number

    def ended(self, number: str, refused: str = "") -> None:
        """Record how the command `number` ended; `refused`: why it failed, empty if it was done. Raises OSError."""
        outcome = {"outcome": "failed", "reason": refused} if refused else {"outcome": "done"}
        self._append({"id": number, "time": calendar_time(), **outcome})

    def read(self, last: int = 200) -> list[dict[str, Any]]:
        """The newest `last` commands, newest first, each with its outcome (`cut off` if it has none)."""
        commands: dict[str, dict[str, Any]] = {}
        for data in JsonLines(self.folder / FILE_NAME).read("id"):
            known = commands.setdefault(data["id"], {"outcome": "cut off"})
            known.update(
                {**data, "ended": data["time"], "time": known["time"]}
                if "outcome" in data and "time" in known
                else data
            )
        return list(reversed(commands.values()))[:last]

    def _append(self, data: dict[str, Any]) -> None:
        JsonLines(self.folder / FILE_NAME).append(data)


T = TypeVar("T")


@final
@dataclass(frozen=True, slots=True)
class Settings:
    """How a console was started: folder of the runs, the cell file if one was named, its own address.

    tls: files of the certificate (with its chain) and of its private key, PEM; None: not encrypted.
    webhook: the address that events are sent to, which may hold a secret; empty: none.
    users: the file of the named users; None: the token allows commands. idle_min: time without use after which they are
    signed out, min.
    """

    runs: Path
    cell: Path | None = None
    host: str = "127.0.0.1"
    port: int = 8090
    tls: tuple[Path, Path] | None = None
    webhook: str = field(default="", repr=False)
    users: Path | None = None
    idle_min: float = IDLE_MIN

    @property
    def scheme(self) -> str:
        """Of its address: `http` or `https`."""
        return "https" if self.tls else "http"


@final
@dataclass(frozen=True, slots=True)
class Console:
    """The state of a console: settings, sessions with the token, audit log, live state of the runs, alarms and queue
    (`watch`), its worker processes (`jobs`).
    """

    settings: Settings
    sessions: Sessions
    audit: Audit
    live: LiveRuns
    watch: Watch
    jobs: Jobs = field(default_factory=Jobs)

    @property
    def runs(self) -> Path:
        """The folder of the runs."""
        return self.settings.runs

    @asynccontextmanager
    async def following(self) -> AsyncIterator[None]:
        """Inside this context, follow the runs of the folder."""
        async with self.live.following():
            tasks = [asyncio.create_task(self.watch.run(self.live), name="alarms and queue")]
            if self.settings.users:
                tasks.append(asyncio.create_task(self.sessions.end_in_time(), name="ends of sessions"))
            if self.settings.webhook:
                webhook = Webhook(self.settings.webhook, self.watch.host)
                self.watch.events.subscribe(webhook.put)
                tasks.append(asyncio.create_task(webhook.run(), name="webhook"))
            try:
                yield
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
                await self.jobs.close()

    async def command(
        self, operator: Operator, name: str, target: str, work: Callable[[], Awaitable[T]], **details: Any
    ) -> T:
        """Carry out `work`, the command `name` for `target`, with its lines in the audit log.

        Work that the end of the console cancels gets no second line. Raises NotAllowed if the operator's role does not
        cover the command; what `work` raises; OSError, before the work, if the audit log cannot be written.
        """
        number = await asyncio.to_thread(self.audit.asked, operator, name, target, details)
        try:
            self.sessions.refuse(operator, name)
            result = await work()
        except Exception as error:
            await asyncio.to_thread(self.audit.ended, number, str(error) or type(error).__name__)
            raise
        await asyncio.to_thread(self.audit.ended, number)
        return result


_of_this_process: list[Console] = []


def use(console: Console) -> None:
    """Make `console` the one of this process."""
    _of_this_process[:] = [console]


def console() -> Console:
    """The console of this process."""
    return _of_this_process[0]
