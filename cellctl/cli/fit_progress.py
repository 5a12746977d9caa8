"""How far a long computation is, on stderr: a live bar on a terminal, plain lines elsewhere; nothing of a short one."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, final

from cellctl.calibration.estimation.progress import Progress

QUIET_S = 2.0
"""Nothing is said in the first seconds."""

EVERY_S = 5.0
"""Plain lines are at least this far apart."""

TELLING = 0.05
"""With less done than this share nobody can tell how long the rest takes."""


@contextmanager
def shown_progress(name: str, clock: Callable[[], float] = time.monotonic) -> Iterator[Progress]:
    """A callback that shows on stderr how far `name` is."""
    shown = _Bar(name, clock) if sys.stderr.isatty() else _Lines(name, clock)
    timer = threading.Timer(QUIET_S, shown.loud)
    timer.daemon = True
    timer.start()
    try:
        yield shown.tell
    finally:
        timer.cancel()
        shown.close()


def time_left(seconds: float, share: float) -> str:
    """`1 min 20 s left`, after so many seconds for this share of the work; empty where nobody can tell."""
    if not TELLING <= share < 1.0:
        return ""
    minutes, rest = divmod(max(round(seconds / share * (1.0 - share)), 1), 60)
    return f"{minutes} min {rest:02d} s left" if minutes else f"{rest} s left"


class _Shown:
    """What was told last; shown once the quiet seconds are over."""

    def __init__(self, name: str, clock: Callable[[], float]) -> None:
        self._name, self._clock, self._began = name, clock, clock()
        self._doing, self._share, self._loud = "", 0.0, False
        self._lock = threading.Lock()

    def tell(self, doing: str, share: float) -> None:
        with self._lock:
            self._doing, self._share = doing, max(share, self._share)
            self._loud = self._loud or self._clock() - self._began >= QUIET_S
            if self._loud:
                self.show()

    def loud(self) -> None:
        """The quiet seconds are over."""
        with self._lock:
            self._loud = True
            self.show()

    def show(self) -> None:
        raise NotImplementedError

    def close(self) -> None:
        """The work is done, or was given up."""

    @property
    def _left(self) -> str:
        return time_left(self._clock() - self._began, self._share)


@final
class _Lines(_Shown):
    """A line where something new is being done, `EVERY_S` after the one before."""

    _last = -EVERY_S

    def show(self) -> None:
        if self._clock() - self._last < EVERY_S or not self._doing:
            return
        self._last = self._clock()
        percent = f"{100.0 * self._share:.0f} %"
        print(f"{self._name}: {', '.join(filter(None, (percent, self._doing, self._left)))}", file=sys.stderr)


@final
class _Bar(_Shown):
    """A bar, taken away when the work is done."""

    _bar: Any = None

    def show(self) -> None:
        if self._bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

            columns = (
                TextColumn(f"{self._name}: {{task.description}}", markup=False),
                BarColumn(),
                TaskProgressColumn(),
                TimeElapsedColumn(),
                TextColumn("{task.fields[left]}"),
            )
            self._bar = Progress(*columns, console=Console(stderr=True), transient=True)
            self._task = self._bar.add_task("", total=1.0, left="")
            self._bar.start()
        self._bar.update(self._task, description=self._doing, completed=self._share, left=self._left)

    def close(self) -> None:
        with self._lock:
            if self._bar is not None:
                self._bar.stop()
