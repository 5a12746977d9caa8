"""Live progress on a terminal, plain lines elsewhere; with the time left."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, final

from cellctl.engine import NobodyWatching, Watcher
from cellctl.journal import DevicesConnected, KnownEvent, Said, StateChanged, StepStarted
from cellctl.operations.campaign import Campaign
from cellctl.procedure import Step

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress


@contextmanager
def progress(campaign: Campaign, folder: Path, *, quiet: bool) -> Iterator[Watcher]:
    """A watcher that shows the run: one live bar on a terminal, a line for each tenth elsewhere, nothing when quiet."""
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
        yield _Shown(console, bar, titles_of(campaign), Passes(campaign.expected_passes))


def titles_of(campaign: Campaign) -> dict[str, str]:
    """What the operator reads while a step runs, by the step's id."""
    steps = (action for action in campaign.procedure.actions() if isinstance(action, Step))
    return {step.id: campaign.registry.find(step.do).title or step.id.replace("_", " ") for step in steps}


def time_left(seconds: float) -> str:
    """A time in words: `3 min 05 s`, `12 s`."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


@final
class Passes:
    """Passes through all loops of a run: how many are done of how many, and how long the others take at this pace.

    expected: what the steps said before the run; more where the loops turn out to have more.
    """

    def __init__(self, expected: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._expected, self._clock = expected, clock
        self._index: dict[str, int] = {}
        self._count: dict[str, int] = {}
        self._began: tuple[float, int] | None = None

    def loop(self, path: str, index: int, count: int) -> None:
        """As `Watcher.loop`; a loop that holds loops is left out once they are seen."""
        around = path.rpartition("[")[0]
        self._index.pop(around, None)
        self._count.pop(around, None)
        if not any(inner.startswith(f"{path}[") for inner in self._index):
            self._index[path], self._count[path] = index, count

    def step_begins(self) -> None:
        """A step is carried out, and not skipped as one that was finished before: time counts from the first."""
        self._began = self._began or (self._clock(), self.done)

    @property
    def done(self) -> int:
        """Passes that are finished."""
        return sum(self._index.values())

    @property
    def total(self) -> int:
        """All passes, as far as that is known."""
        return max(self._expected, sum(self._count.values()))

    @property
    def left(self) -> str:
        """`3 min 05 s left`; empty where nobody can tell yet."""
        if self._began is None or not self._began[1] < self.done < self.total:
            return ""
        began, before = self._began
        return f"{time_left((self._clock() - began) / (self.done - before) * (self.total - self.done))} left"


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
                for name, who in identities.items():
                    firmware = f", {who['firmware']}" if who["firmware"] else ""
                    self._console.print(f"  {name}: {who['model']}, serial {who['serial']}{firmware}")
            case StateChanged(after="connecting"):
                self._console.print("connecting …")
            case StateChanged(after=after, reason=reason) if after in ("paused", "cleaning") and reason:
                self._console.print(f"{after}: {reason}")
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
        done, total, left = self._passes.done, self._passes.total, self._passes.left
        self._bar.update(self._task, description=self._title, completed=done, total=total or None, left=left)
        if self._bar.disable and total and 10 * done // total > self._tenth:
            self._tenth = 10 * done // total
            self._console.print(f"  {self._title}: {done} of {total}{', ' + left if left else ''}")
