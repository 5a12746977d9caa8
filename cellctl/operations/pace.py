"""Progress in proportion to time: the work that a fit has done shows how long the rest will take.

A fit has parts: the identification of the model, then one for each fold. The first part that is done shows how its
share grows with time, and the folds that are done show how long a fold takes.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np

from cellctl.calibration.identification.progress import Progress

TELLING = 0.05
"""Below this share of the work the time left cannot be estimated."""


def time_left(seconds: float, share: float) -> str:
    """`1 min 20 s left`, from the seconds for this share of the work; empty if it cannot be estimated."""
    if not TELLING <= share < 1.0:
        return ""
    minutes, rest = divmod(max(round(seconds / share * (1.0 - share)), 1), 60)
    return f"{minutes} min {rest:02d} s left" if minutes else f"{rest} s left"


def continued(progress: Progress, before: float, clock: Callable[[], float]) -> Progress:
    """A progress of work that begins now, `before` seconds after the whole began: its share becomes that of the whole
    time.
    """
    began = clock()

    def told(doing: str, share: float) -> None:
        taken = clock() - began
        progress(doing, (before + taken) / max(before + taken / share, 1e-9) if share > 0.0 else 0.0)

    return told


@final
@dataclass
class _Part:
    """A part that has begun: when, its latest share, and all shares with their times, s; seconds: once it is done."""

    began: float
    share: float = 0.0
    told: list[tuple[float, float]] = field(default_factory=list)
    seconds: float | None = None


@final
class Pace:
    """Reports to `progress` the share of a fit's time that is over, from the shares of its parts.

    lanes: parts that are computed one after another in each process, by their numbers; 0 is the model, which begins
    first. expected: how many folds one process computes, once the seconds of one are known or estimated.
    """

    def __init__(
        self, progress: Progress, folds: int, expected: Callable[[float], int], clock: Callable[[], float]
    ) -> None:
        self._progress, self._expected, self._clock = progress, expected, clock
        self._folds, self._parts = folds, dict[int, _Part]()
        self._began, self._lock = clock(), threading.Lock()
        self.lanes: Sequence[Sequence[int]] | None = None

    def part(self, number: int) -> Progress:
        """The progress of a part, by its own shares, 0 to 1."""
        name = f"fold {number} of {self._folds}" if number else ""

        def told(doing: str, share: float) -> None:
            with self._lock:
                now = self._clock()
                part = self._parts.setdefault(number, _Part(now))
                part.share = max(part.share, share)
                part.told.append((part.share, now - part.began))
                left = self._left(now)
                over = 0.0 if left is None else (now - self._began) / max(now - self._began + left, 1e-9)
                self._progress(": ".join(word for word in (name, doing) if word), over)

        return told

    def ended(self, number: int) -> None:
        """A part is done."""
        with self._lock:
            now = self._clock()
            part = self._parts.setdefault(number, _Part(now))
            part.seconds = now - part.began

    def _left(self, now: float) -> float | None:
        """Seconds that are left; None while nothing shows it."""
        model = self._parts.get(0)
        if model is None or (model.seconds is None and model.share <= 0.0):
            return None
        if model.seconds is None:
            whole = (now - model.began) / model.share
            return whole * (1.0 - model.share) + whole * self._expected(whole)
        done = [part.seconds for number, part in self._parts.items() if number and part.seconds is not None]
        each = sum(done) / len(done) if done else model.seconds
        lanes = self.lanes or [range(1, self._folds + 1)]
        return max((sum(self._left_of(number, each, now) for number in lane) for lane in lanes), default=0.0)

    def _left_of(self, number: int, seconds: float, now: float) -> float:
        """Seconds that are left of a fold that takes `seconds`: also the time since its last report is over."""
        part = self._parts.get(number)
        since = now - part.began - part.told[-1][1] if part and part.told and part.seconds is None else 0.0
        return max(seconds * (1.0 - self._over(number)) - since, 0.0)

    def _over(self, number: int) -> float:
        """The share of a fold's time that is over, 0 to 1, as its share of the work was reached in the model."""
        part, model = self._parts.get(number), self._parts[0]
        if part is None:
            return 0.0
        if part.seconds is not None or not model.seconds:
            return 1.0
        shares, times = zip(*model.told, strict=True)
        return float(np.interp(part.share, [*shares, 1.0], [*(time / model.seconds for time in times), 1.0]))
