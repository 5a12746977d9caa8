"""All runs of a folder, followed for all pages by two tasks of the event loop; who is called when one changes."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Set
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Self, final

from cellctl.console.live._run import UNREADABLE, Found, LiveRun, Snapshot, Stamp, stamp, stamps, unexpected
from cellctl.files import InputError, Problem
from cellctl.journal import JournalError, RunState, fold, read_journal, writer_of
from cellctl.journal.journal_file import LOCK_NAME
from cellctl.operations.run_list import RunSummary, run_summary
from cellctl.procedure import StepRegistry


@final
class Subscribers:
    """Callbacks, each for one run or for all. One that raises is not called again."""

    def __init__(self) -> None:
        self._found: dict[int, tuple[Callable[[], object], str]] = {}
        self._last = 0

    def add(self, callback: Callable[[], object], run: str = "") -> Callable[[], None]:
        """Call `callback` when `run` changes, or any run if it is empty; returns what ends that."""
        self._last += 1
        number = self._last
        self._found[number] = (callback, run)

        def end() -> None:
            self._found.pop(number, None)

        return end

    def wait_for(self, run: str) -> bool:
        """Whether a callback is for `run` alone."""
        return any(each == run for _, each in self._found.values())

    def call(self, runs: Set[str]) -> None:
        """Call once each that waits for one of `runs`."""
        for number, (callback, run) in list(self._found.items()):
            if runs and (not run or run in runs) and number in self._found:
                try:
                    callback()
                except Exception:  # a page that is gone must not stop the others
                    logging.getLogger(__name__).exception("a subscriber failed; it is not called again")
                    self._found.pop(number, None)


RunStamp = tuple[Stamp, Stamp, Stamp]
"""Stamps of journal, write-ahead log and lock of a run."""


@final
class RunsFolder:
    """The runs in `path`, by name. An unchanged run costs three file stamps for each look."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stamps: dict[str, RunStamp] = {}

    def look(self) -> tuple[list[str], list[str]]:
        """The runs that are new or have changed since the last look, the latest change first, and those that are gone.

        A folder that is missing or cannot be read has no runs.
        """
        now = dict(self._found())
        changed = [name for name, found in now.items() if found != self._stamps.get(name)]
        gone = [name for name in self._stamps if name not in now]
        self._stamps = now
        return sorted(changed, key=lambda name: _changed_ns(now[name]), reverse=True), gone

    def _found(self) -> list[tuple[str, RunStamp]]:
        try:
            folders = list(self._path.iterdir())
        except OSError:
            return []
        each = ((folder.name, (*stamps(folder), stamp(folder / LOCK_NAME))) for folder in folders)
        return [(name, found) for name, found in each if found[0]]


def is_written(run_folder: Path) -> bool:
    """Whether a process writes the run; call it only after the run has changed (see `JournalTail`)."""
    lock = stamp(run_folder / LOCK_NAME)
    return bool(lock and lock[1]) and writer_of(run_folder) is not None


def _changed_ns(found: RunStamp) -> int:
    return max(each[2] for each in found if each)


@final
@dataclass(frozen=True, slots=True)
class RunRow:
    """A run in the list of runs.

    `summary`: of an unreadable run only `run` and `state`. `active`: it is in progress.
    `problem`: why it cannot be read. `events`: number of the last event that it contains.
    """

    run: str
    folder: Path
    summary: RunSummary
    active: bool = False
    problem: Problem | None = None
    events: int = 0

    @property
    def began(self) -> str:
        """When it began, UTC, ISO 8601; empty if unknown."""
        return self.summary.began or ""

    @property
    def state(self) -> str:
        """Its state."""
        return self.summary.state

    @classmethod
    def of_folder(cls, folder: Path) -> Self:
        """By reading the whole journal, in any thread."""
        try:
            return cls._of(folder, fold(read_journal(folder)))
        except JournalError as error:
            return cls._unreadable(folder, Problem(str(error.path), 0, 0, error.what, error.cure))

    @classmethod
    def of_snapshot(cls, snapshot: Snapshot) -> Self:
        """By the state of a run that is followed, in the event loop."""
        if snapshot.problem and not snapshot.events:
            return cls._unreadable(snapshot.folder, snapshot.problem)
        return cls._of(snapshot.folder, snapshot.state, active=snapshot.active, problem=snapshot.problem)

    @classmethod
    def _of(cls, folder: Path, state: RunState, *, active: bool = False, problem: Problem | None = None) -> Self:
        try:
            return cls(folder.name, folder, run_summary(folder, state), active, problem, state.last_seq)
        except InputError as error:  # rows of another version
            return cls._unreadable(folder, error.problems[0])
        except Exception as error:
            return cls._unreadable(folder, unexpected(folder, error))

    @classmethod
    def _unreadable(cls, folder: Path, problem: Problem) -> Self:
        return cls(folder.name, folder, RunSummary(run=folder.name, state=UNREADABLE), problem=problem)


_LONGEST = 255
"""Number of bytes of a file name at most."""

_BATCH = 10
"""Number of old runs that are read between two looks at the folder."""

_KEPT = 8
"""Number of runs without a process that are followed: the ones asked for last."""


@final
class LiveRuns:
    """The runs in `folder`. Use it in one event loop; inside `following` it is kept up to date.

    `registry`: the kinds of steps, for titles and progress; asked for once, in a thread. `look_s`: wall time between
    two looks at the runs that are followed, s; `folder_s`: between two looks at the folder for new and changed runs.
    """

    def __init__(
        self,
        folder: Path,
        registry: Callable[[], StepRegistry] = StepRegistry.installed,
        *,
        look_s: float = 0.05,
        folder_s: float = 1.0,
    ) -> None:
        self.folder = folder
        self._look_s, self._folder_s = look_s, folder_s
        self.rows: tuple[RunRow, ...] = ()
        self._registry = cache(registry)
        self._found = RunsFolder(folder)
        self._rows: dict[str, RunRow] = {}
        self._followed: dict[str, LiveRun] = {}
        self._unread: list[str] = []
        self._stale: set[str] = set()
        self._first_look = True
        self._subscribers = Subscribers()
        self._looked = asyncio.Event()

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the runs in progress, the one that began last first."""
        return tuple(row.run for row in self.rows if row.active)

    @property
    def reading(self) -> bool:
        """Whether runs of the folder are not read yet, so that `rows` is not complete."""
        return self._first_look or bool(self._unread)

    def subscribe(self, callback: Callable[[], object], run: str = "") -> Callable[[], None]:
        """Call `callback` after `run` has changed, or any run if it is empty; returns the function that ends that.

        It is called in the event loop, once for all changes of one look. It must return at once: let it set a flag or
        an `asyncio.Event`. One that raises is not called again.
        """
        return self._subscribers.add(callback, run)

    def run(self, name: str) -> LiveRun:
        """The run `name`, followed from now on. Its snapshot is empty until the next look: see `snapshot`.

        Raises InputError if `name` cannot be the name of a run.
        """
        if name in ("", ".", "..") or {"/", "\\", "\0"} & set(name) or len(name.encode(errors="replace")) > _LONGEST:
            raise InputError(Problem(name, 0, 0, "is no name of a run", "name a run folder of this console"))
        live = self._followed.pop(name, None) or LiveRun(self.folder / name, self._registry)
        self._followed[name] = live  # the one asked for last is the last
        return live

    async def snapshot(self, name: str) -> Snapshot:
        """The run `name` with all events of its journal; `problem` says if there is none. Raises InputError."""
        live = self.run(name)
        while not live.known:
            await self._looked.wait()
        return live.snapshot

    @asynccontextmanager
    async def following(self) -> AsyncIterator[None]:
        """Inside this context, follow the runs."""
        with ThreadPoolExecutor(1, "live-runs") as looks, ThreadPoolExecutor(1, "old-runs") as reads:
            tasks = [
                asyncio.create_task(_forever(lambda: self._look(looks), self._look_s), name="live runs"),
                asyncio.create_task(_forever(lambda: self._look_at_folder(reads), self._folder_s), name="runs folder"),
            ]
            try:
                yield
            finally:
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)

    async def _look(self, thread: ThreadPoolExecutor) -> bool:
        """Look once at every run that is followed; returns whether there is more to read."""
        followed = list(self._followed.values())
        found = await asyncio.get_running_loop().run_in_executor(thread, _read, followed)
        changed = {live.name for live, each in found if each is not None and live.take(each)}
        for name in changed:
            self._renew_row(self._followed.get(name))
        self._looked.set()
        self._looked = asyncio.Event()
        self._forget()
        self._subscribers.call(changed)
        return any(each is not None and each.more for _, each in found)

    def _renew_row(self, live: LiveRun | None) -> None:
        """Renew the row of a followed run now if its state changed, else at the next look at the folder."""
        if live is None or not live.snapshot.events:
            return
        row, now = self._rows.get(live.name), live.snapshot
        before = row and (row.active, row.state, row.summary.process, row.summary.verdict or "")
        if before == (now.active, now.status.state, now.status.process, now.verdict):
            self._stale.add(live.name)
        else:
            self._put(RunRow.of_snapshot(now))

    async def _look_at_folder(self, thread: ThreadPoolExecutor) -> bool:
        """Find new, changed and deleted runs, and read some of them; returns whether there are more to read."""
        loop = asyncio.get_running_loop()
        changed, gone = await loop.run_in_executor(thread, self._found.look)
        waiting = [name for name in self._unread if name not in gone and name not in changed]
        self._unread = changed + waiting
        now = self._unread[:_BATCH]
        for name in gone:
            self._rows.pop(name, None)
        for name in now:
            live = self._followed.get(name)
            if live is None or not live.snapshot.writing:
                row = await loop.run_in_executor(thread, _row_of_unwritten, self.folder / name)
                self._put(row) if row else self.run(name)
        self._unread = self._unread[_BATCH:]
        stale = {name for name in self._stale & self._followed.keys() & self._rows.keys() if self._outdated(name)}
        self._stale -= stale
        for name in stale:
            self._put(RunRow.of_snapshot(self._followed[name].snapshot))
        self._sort()
        self._first_look = False
        self._subscribers.call({*now, *gone, *stale})
        return bool(self._unread)

    def _outdated(self, name: str) -> bool:
        """Whether a row misses 2 % of the events: to summarise a long run at each event would take too long."""
        events = self._followed[name].snapshot.events
        return events - self._rows[name].events >= 0.02 * events

    def _put(self, row: RunRow) -> None:
        self._rows[row.run] = row
        self._sort()

    def _sort(self) -> None:
        self.rows = tuple(sorted(self._rows.values(), key=lambda row: (row.began, row.run), reverse=True))

    def _forget(self) -> None:
        """Follow no longer the runs without a process and page that were not asked for lately."""
        idle = [
            name
            for name, live in self._followed.items()
            if live.known and not live.snapshot.writing and not self._subscribers.wait_for(name)
        ]
        for name in idle[:-_KEPT]:
            del self._followed[name]


def _read(followed: list[LiveRun]) -> list[tuple[LiveRun, Found | None]]:
    return [(live, live.read()) for live in followed]


def _row_of_unwritten(folder: Path) -> RunRow | None:
    """The row of a run by its whole journal; None if a process writes it: that one is followed."""
    return None if is_written(folder) else RunRow.of_folder(folder)


async def _forever(look: Callable[[], Awaitable[bool]], pause_s: float) -> None:
    """Look again and again, with a pause unless there is more to read. An error is logged, and does not end it."""
    while True:
        try:
            more = await look()
        except Exception:
            logging.getLogger(__name__).exception("the live state of the runs is not up to date")
            more = False
        await asyncio.sleep(0.0 if more else pause_s)
