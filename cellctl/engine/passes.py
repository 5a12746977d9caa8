"""Progress of a run and the time left, counted in passes of its loops."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import final


@final
class Passes:
    """Passes through all loops of a run: done, total, and the time left at the present rate.

    expected: the steps' estimate before the run; raised if the loops have more passes. clock: seconds.
    """

    def __init__(self, expected: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._expected, self._clock = expected, clock
        self._index: dict[str, int] = {}
        self._count: dict[str, int] = {}
        self._began: tuple[float, int] | None = None

    def loop(self, path: str, index: int, count: int) -> None:
        """As `Watcher.loop`; a loop that contains loops is not counted once those have begun."""
        around = path.rpartition("[")[0]
        self._index.pop(around, None)
        self._count.pop(around, None)
        if not any(inner.startswith(f"{path}[") for inner in self._index):
            self._index[path], self._count[path] = index, count

    def step_begins(self) -> None:
        """A step is executed, not skipped as already finished: time counts from the first one."""
        self._began = self._began or (self._clock(), self.done)

    @property
    def done(self) -> int:
        """Finished passes."""
        return sum(self._index.values())

    @property
    def total(self) -> int:
        """All passes known so far."""
        return max(self._expected, sum(self._count.values()))

    @property
    def left_s(self) -> float | None:
        """Seconds for the remaining passes; None if not known yet."""
        if self._began is None or not self._began[1] < self.done < self.total:
            return None
        began, before = self._began
        return (self._clock() - began) / (self.done - before) * (self.total - self.done)
