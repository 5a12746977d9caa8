"""Progress of a long computation, on stderr: a live bar on a terminal, else plain lines; none for a short one."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, final

from cellctl.calibration.identification.progress import Progress
from cellctl.operations.pace import time_left

QUIET_S = 2.0
"""No output in the first seconds."""

EVERY_S = 5.0
"""Least time between plain lines, s."""


@contextmanager
def shown_progress(name: str, clock: Callable[[], float] = time.monotonic) -> Iterator[Progress]:
    """A callback that shows the progress of `name` on stderr."""
    shown = _Bar(name, clock) if sys.stderr.isatty() else _Lines(name, clock)
    timer = threading.Timer(QUIET_S, shown.loud)
    timer.daemon = True
    timer.start()
    try:
        yield shown.tell
    finally:
        timer.cancel()
        shown.close()


class _Shown:
    """The latest progress; shown after the quiet seconds."""

    def __init__(self, name: str, clock: Callable[[], float]) -> None:
        self._name, self._clock, self._began = name, clock, clock()
        self._doing, self._share, self._loud = "", 0.0, False
        self._lock = threading.Lock()

    def tell(self, doing: str, share: float) -> None:
        with self._lock:
            self._doing, self._share = doing, share
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
        """The work is done or cancelled."""

    @property
    def _left(self) -> str:
        return time_left(self._clock() - self._began, self._share)


@final
class _Lines(_Shown):
    """A line for each new activity, at least `EVERY_S` after the previous one."""

    _last = -EVERY_S

    def show(self) -> None:
        if self._clock() - self._last < EVERY_S or not self._doing:
            return
        self._last = self._clock()
        percent = f"{100.0 * self._share:.0f} %"
        print(f"{self._name}: {', '.join(filter(None, (percent, self._doing, self._left)))}", file=sys.stderr)


@final
class _Bar(_Shown):
    """A bar, removed when the work is done."""

    _bar: Any = None

    def show(self) -> None:
        if self._bar is None:
            from rich.console import Console  # only for people: 0.1 s
            from rich.progress import (  # only for people: 0.1 s
                BarColumn,
                Progress,
                TaskProgressColumn,
                TextColumn,
                TimeElapsedColumn,
            )

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
