"""What pages and API share: one `Console` for each process."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar, final

from cellctl.console.audit import Audit
from cellctl.console.jobs import Jobs
from cellctl.console.live import LiveRuns
from cellctl.console.sessions import Sessions
from cellctl.engine import Operator

T = TypeVar("T")


@final
@dataclass(frozen=True, slots=True)
class Settings:
    """How a console was started: folder of the runs, the cell file if one was named, its own address."""

    runs: Path
    cell: Path | None = None
    host: str = "127.0.0.1"
    port: int = 8090


@final
@dataclass(frozen=True, slots=True)
class Console:
    """The state of a console: settings, sessions with the token, audit log, live state of the runs, its jobs."""

    settings: Settings
    sessions: Sessions
    audit: Audit
    live: LiveRuns
    jobs: Jobs = field(default_factory=Jobs)

    @property
    def runs(self) -> Path:
        """The folder of the runs."""
        return self.settings.runs

    @asynccontextmanager
    async def following(self) -> AsyncIterator[None]:
        """Inside this context, follow the runs of the folder."""
        async with self.live.following():
            try:
                yield
            finally:
                await self.jobs.close()

    async def command(
        self, operator: Operator, name: str, target: str, work: Callable[[], Awaitable[T]], **details: Any
    ) -> T:
        """Carry out `work`, the command `name` for `target`, with its lines in the audit log.

        Work that the end of the console cancels gets no second line. Raises what `work` raises; OSError, before the
        work, if the audit log cannot be written.
        """
        number = await asyncio.to_thread(self.audit.asked, operator, name, target, details)
        try:
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
