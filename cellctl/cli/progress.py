"""Live progress on a terminal, plain lines elsewhere; with the time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import final

from cellctl.engine import NobodyWatching, Watcher
from cellctl.journal import DevicesConnected, KnownEvent, Said, StateChanged
from cellctl.operations.campaign import Campaign


@contextmanager
def progress(campaign: Campaign, folder: Path, *, quiet: bool) -> Iterator[Watcher]:
    """A watcher that shows the run: a live bar on a terminal, a line for each tenth elsewhere, nothing when quiet."""
    if quiet:
        yield NobodyWatching()
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    console = Console(highlight=False, soft_wrap=True)
    kind = "simulated" if campaign.cell.simulated else "REAL"
    console.print(f"{campaign.procedure.title}\ncell: {campaign.cell.name} ({kind})\nrun:  {folder}")
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not sys.stdout.isatty()) as bar:
        yield _Shown(console, bar)


@final
class _Shown:
    """Shows events as lines above one bar per loop."""

    def __init__(self, console: object, bar: object) -> None:
        from rich.console import Console
        from rich.progress import Progress, TaskID

        assert isinstance(console, Console)
        assert isinstance(bar, Progress)
        self._console = console
        self._bar = bar
        self._tasks: dict[str, TaskID] = {}
        self._began: dict[str, float] = {}

    def event(self, event: KnownEvent) -> None:
        match event:
            case DevicesConnected(identities):
                for name, who in identities.items():
                    firmware = f", {who['firmware']}" if who["firmware"] else ""
                    self._console.print(f"  {name}: {who['model']}, serial {who['serial']}{firmware}")
            case StateChanged(after="connecting"):
                self._console.print("connecting …")
            case StateChanged(after=after, reason=reason) if after in ("paused", "cleaning") and reason:
                self._console.print(f"{after}: {reason}")
            case Said(text=text):
                self._console.print(f"  {text}")
            case _:
                pass

    def loop(self, path: str, index: int, count: int) -> None:
        if path not in self._tasks:
            self._tasks[path] = self._bar.add_task(path, total=count, left="")
            self._began[path] = time.monotonic()
        left = self._left(path, index, count)
        self._bar.update(self._tasks[path], completed=index, left=left)
        tenth = max(1, count // 10)
        if self._bar.disable and index and (index % tenth == 0 or index == count):
            self._console.print(f"  {path}: {index} of {count}{', ' + left if left else ''}")

    def _left(self, path: str, index: int, count: int) -> str:
        if not 0 < index < count:
            return ""
        seconds = (time.monotonic() - self._began[path]) / index * (count - index)
        minutes, rest = divmod(round(seconds), 60)
        return f"{minutes} min {rest:02d} s left" if minutes else f"{rest} s left"
