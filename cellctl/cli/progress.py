"""Progress with the time left: live on a terminal, else as plain lines."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, final

from cellctl.engine import NobodyWatching, Passes, Watcher
from cellctl.journal import DevicesConnected, KnownEvent, Said, StateChanged, StepStarted
from cellctl.operations.campaign import Campaign
from cellctl.procedure import phase_titles

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


@contextmanager
def progress(campaign: Campaign, folder: Path, *, quiet: bool) -> Iterator[Watcher]:
    """A watcher that shows the run: a live bar on a terminal, else a line for each tenth; no output when quiet."""
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
        yield _Shown(
            console, bar, phase_titles(campaign.procedure, campaign.registry), Passes(campaign.expected_passes)
        )


_GO_ON = "remove the cause, if any, and acknowledge messages of the robot; then `cellctl continue`, or `cellctl abort`"


def time_left(seconds: float) -> str:
    """A time in words: `3 min 05 s`, `12 s`."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


@final
class _Shown:
    """Shows events as lines above one bar for the whole run."""

    def __init__(self, console: Console, bar: Progress, titles: Mapping[str, str], passes: Passes) -> None:
        self._console, self._bar, self._titles, self._passes = console, bar, titles, passes
        self._task = bar.add_task("starting", total=passes.total or None, left="")
        self._title, self._tenth = "starting", 0

    def event(self, event: KnownEvent) -> None:
        match event:
            case DevicesConnected(identities):
                for name, identity in identities.items():
                    firmware = f", {identity['firmware']}" if identity["firmware"] else ""
                    self._console.print(f"  {name}: {identity['model']}, serial {identity['serial']}{firmware}")
            case StateChanged(after="connecting"):
                self._console.print("connecting …")
            case StateChanged(after="paused", reason=reason):
                self._console.print(f"paused: {reason}\n    {_GO_ON}")
            case StateChanged(after="cleaning", reason=reason) if reason:
                self._console.print(f"cleaning: {reason}")
            case Said(text=text):
                self._console.print(f"  {text}")
            case StepStarted(step=step):
                self._title = self._titles.get(step.rpartition(".")[2], self._title)
                if "[" in step:
                    self._passes.step_begins()
                self._show()
            case _:
                pass

    def loop(self, path: str, index: int, count: int) -> None:
        self._passes.loop(path, index, count)
        self._show()

    def _show(self) -> None:
        done, total, left_s = self._passes.done, self._passes.total, self._passes.left_s
        left = "" if left_s is None else f"{time_left(left_s)} left"
        self._bar.update(self._task, description=self._title, completed=done, total=total or None, left=left)
        if self._bar.disable and total and 10 * done // total > self._tenth:
            self._tenth = 10 * done // total
            self._console.print(f"  {self._title}: {done} of {total}{', ' + left if left else ''}")
