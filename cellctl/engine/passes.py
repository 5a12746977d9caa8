"""How much of a run is done, and how long the rest takes: counted in passes of its loops."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import final


@final
class Passes:
    """Passes through all loops of a run: how many are done of how many, and how long the others take at this pace.

    expected: what the steps said before the run; more where the loops turn out to have more. clock: seconds.
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
    def left_s(self) -> float | None:
        """Seconds that the other passes take; None where that is not known yet."""
        if self._began is None or not self._began[1] < self.done < self.total:
            return None
        began, before = self._began
        return (self._clock() - began) / (self.done - before) * (self.total - self.done)
