"""The runs of a folder for all pages: those in progress followed by two tasks of the event loop, all in the index;
who is called when one changes.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable, Set
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, suppress
from functools import cache
from pathlib import Path
from threading import Lock
from typing import final

from cellctl.console.live._run import Found, LiveRun, Snapshot
from cellctl.files import InputError, Problem
from cellctl.operations.run_indexing import followed_run, read_run
from cellctl.procedure import StepRegistry
from cellctl.run_index import Changes, IndexedRun, IndexUnusable, RunIndex, Scanner, opened_index, remove_damaged


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


_LONGEST = 255
"""Number of bytes of a file name at most."""

_BATCH = 10
"""Number of runs that are read between two looks at the folder."""

_PATIENCE_S = 10.0
"""Longest wait for the index of a folder whose runs are not read yet, of wall time: 75 000 runs take minutes."""

_SHARE = 200.0
"""A thorough look at a folder, which takes longer with each run, is made after this multiple of its own time."""

_KEPT = 8
"""Number of runs without a process that are followed: the ones asked for last."""


@final
class LiveRuns:
    """The runs in `folder`. Use it in one event loop; inside `following` it is kept up to date.

    Runs in progress are followed by their journals, the ended ones are in the index. `version` rises with each change
    of the list, `states_version` when a run begins, ends, goes, or has another state or verdict.

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
        self.version = self.states_version = 0
        self._registry = cache(registry)
        self._opened: tuple[RunIndex, Scanner] | None = None
        self._opening = Lock()
        self._followed: dict[str, LiveRun] = {}
        self._unread: list[str] = []
        self._written: dict[str, int] = {}
        self._shown: dict[str, tuple[bool, str, str]] = {}
        self._stale: set[str] = set()
        self._thorough_at = 0.0
        self._subscribers = Subscribers()
        self._looked, self._indexed = asyncio.Event(), asyncio.Event()

    @property
    def index(self) -> RunIndex:
        """The index of the folder: of all its runs when `reading` is false. Ask it in a thread."""
        return self._opened_index()[0]

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the runs in progress, the one that began last first."""
        found = [live for live in self._followed.values() if live.snapshot.active]
        found.sort(key=lambda live: (live.snapshot.state.calendar, live.name), reverse=True)
        return tuple(live.name for live in found)

    @property
    def reading(self) -> bool:
        """Whether runs of the folder are not read yet, so that the index is not complete."""
        return not self._indexed.is_set()

    async def indexed(self) -> None:
        """Wait until every run of the folder is in the index, at most some seconds."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_PATIENCE_S):
                await self._indexed.wait()

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
        if self._opened:
            self._opened[0].close()

    async def _look(self, thread: ThreadPoolExecutor) -> bool:
        """Look once at every run that is followed; returns whether there is more to read."""
        loop = asyncio.get_running_loop()
        followed = list(self._followed.values())
        found = await loop.run_in_executor(thread, _read, followed)
        changed = {live.name for live, each in found if each is not None and live.take(each)}
        renewed = {name for name in changed if self._has_another_state(name)}
        self._stale |= changed - renewed
        if renewed:
            await self._write(renewed, thread)
            self.states_version += 1
        self._looked.set()
        self._looked = asyncio.Event()
        self._forget()
        self._subscribers.call(changed)
        return any(each is not None and each.more for _, each in found)

    def _has_another_state(self, name: str) -> bool:
        """Whether the list shows another state or verdict of a followed run than the index has."""
        live = self._followed.get(name)
        if live is None or not live.snapshot.events:
            return False
        now = live.snapshot
        before, self._shown[name] = self._shown.get(name), (now.active, now.status.state, now.verdict)
        return before != self._shown[name] and (now.writing or before is not None)

    async def _write(self, names: Iterable[str], thread: ThreadPoolExecutor) -> None:
        """Write what is known of followed runs into the index."""
        found = []
        for name in names:
            live = self._followed[name]
            self._written[name] = live.snapshot.events
            found.append(followed_run(live.folder, live.snapshot.state))
        await asyncio.get_running_loop().run_in_executor(thread, self._put, found)
        self.version += 1

    def _put(self, found: list[IndexedRun]) -> None:
        try:
            self.index.put(found)
        except IndexUnusable as error:
            self._open_again(error)

    async def _look_at_folder(self, thread: ThreadPoolExecutor) -> bool:
        """Find new, changed and deleted runs, and read some of them; returns whether there are more to read."""
        loop = asyncio.get_running_loop()
        writing = {name for name, live in self._followed.items() if live.snapshot.writing}
        now = loop.time()
        thorough = now >= self._thorough_at
        changes = await loop.run_in_executor(thread, self._changes, thorough, writing)
        if changes is None:
            return False
        if thorough:
            self._thorough_at = loop.time() + _SHARE * (loop.time() - now)
        waiting = [name for name in self._unread if name not in changes.gone and name not in changes.unread]
        unread = [*changes.unread, *waiting]
        first, self._unread = unread[:_BATCH], unread[_BATCH:]
        written = await loop.run_in_executor(thread, self._take, first, changes, not self._unread)
        for name in written:
            self.run(name)
        stale = {name for name in self._stale & self._followed.keys() if self._outdated(name)}
        self._stale -= stale
        await self._write(stale, thread)
        if first or changes.gone:
            self.version += 1
            self.states_version += 1
        if not self._unread:
            self._indexed.set()
        self._subscribers.call({*first, *changes.gone, *stale})
        return bool(self._unread)

    def _changes(self, thorough: bool, writing: set[str]) -> Changes | None:
        try:
            return self._opened_index()[1].look(thorough=thorough, but=writing)
        except IndexUnusable as error:
            self._open_again(error)
            return None

    def _take(self, names: list[str], changes: Changes, last: bool) -> list[str]:
        """Read runs into the index; returns those that a process writes, which have to be followed."""
        index, scanner = self._opened_index()
        found = [read_run(self.folder / name) for name in names]
        try:
            index.put(found)
            index.vanish(changes.gone)
            if last:
                scanner.done(changes)
        except IndexUnusable as error:
            self._open_again(error)
        return [run.run for run in found if run.process]

    def _opened_index(self) -> tuple[RunIndex, Scanner]:
        with self._opening:
            if self._opened is None:
                index = opened_index(self.folder)
                self._opened = index, Scanner(index, self.folder)
            return self._opened

    def _open_again(self, error: IndexUnusable) -> None:
        """Open the index again, or another one; what is missing in it is read again."""
        logging.getLogger(__name__).warning("the index of the runs is opened again: %s", error)
        with self._opening:
            if self._opened:
                self._opened[0].close()
                self._opened = None
            remove_damaged(self.folder, thorough=True)

    def _outdated(self, name: str) -> bool:
        """Whether a row misses 2 % of the events: to summarise a long run at each event would take too long."""
        live = self._followed[name].snapshot
        return live.writing and live.events - self._written.get(name, 0) >= 0.02 * live.events

    def _forget(self) -> None:
        """Follow no longer the runs without a process and page that were not asked for lately."""
        idle = [
            name
            for name, live in self._followed.items()
            if live.known and not live.snapshot.writing and not self._subscribers.wait_for(name)
        ]
        for name in idle[:-_KEPT]:
            del self._followed[name]
            self._written.pop(name, None)
            self._shown.pop(name, None)


def _read(followed: list[LiveRun]) -> list[tuple[LiveRun, Found | None]]:
    return [(live, live.read()) for live in followed]


async def _forever(look: Callable[[], Awaitable[bool]], pause_s: float) -> None:
    """Look again and again, with a pause unless there is more to read. An error is logged, and does not end it."""
    while True:
        try:
            more = await look()
        except Exception:
            logging.getLogger(__name__).exception("the live state of the runs is not up to date")
            more = False
        await asyncio.sleep(0.0 if more else pause_s)
