"""The controller's own programs: joints as its path planner yields them, one set in every interpolation step."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any, final

from sims.krc.rsi_exchange import MS
from sims.scene.motions import Joints
from sims.simulator import Refused

_MOST_STEPS = 20_000


@final
class OwnProgram:
    """A motion along `steps`, joints in degrees `every_ns` apart; between them the cubic through each and its mean
    slope. It begins and ends at standstill, as its first and last steps are alike.
    """

    __slots__ = ("_every_ns", "_steps", "end_ns", "start_ns")

    def __init__(self, steps: Sequence[Joints], every_ns: int, time_ns: int = 0) -> None:
        self._steps = tuple(steps)
        self._every_ns = every_ns
        self.start_ns = time_ns
        self.end_ns = time_ns + (len(self._steps) - 1) * every_ns

    def begun(self, joints: Joints, time_ns: int) -> OwnProgram:
        """The same from now on."""
        return OwnProgram(self._steps, self._every_ns, time_ns)

    @property
    def first(self) -> Joints:
        """Where it begins."""
        return self._steps[0]

    @property
    def last(self) -> Joints:
        """Where it ends."""
        return self._steps[-1]

    def share(self, time_ns: int) -> float:
        """Share of its time that is over."""
        return min(max((time_ns - self.start_ns) / (self.end_ns - self.start_ns), 0.0), 1.0)

    def at(self, time_ns: int) -> Joints:
        """Joints, degrees."""
        step, s = self._place(time_ns)
        r = 1.0 - s
        weights = (1.0 + 2.0 * s) * r * r, s * r * r, s * s * (3.0 - 2.0 * s), -s * s * r
        return self._weighted(step, weights)

    def velocity(self, time_ns: int) -> Joints:
        """Their derivative, deg/s."""
        step, s = self._place(time_ns)
        rate = 1e9 / self._every_ns
        slope = 6.0 * s * (1.0 - s)
        weights = -slope * rate, (1.0 - s) * (1.0 - 3.0 * s) * rate, slope * rate, s * (3.0 * s - 2.0) * rate
        return self._weighted(step, weights)

    def _place(self, time_ns: int) -> tuple[int, float]:
        """The step before, and how far to the next, 0 … 1."""
        gone = min(max(time_ns - self.start_ns, 0), self.end_ns - self.start_ns)
        step = min(gone // self._every_ns, len(self._steps) - 2)
        return step, gone / self._every_ns - step

    def _weighted(self, step: int, weights: tuple[float, float, float, float]) -> Joints:
        (a, b), slopes = self._steps[step : step + 2], (self._slope(step), self._slope(step + 1))
        w = weights
        rows = zip(a, slopes[0], b, slopes[1], strict=True)
        return tuple(w[0] * p + w[1] * u + w[2] * q + w[3] * v for p, u, q, v in rows)

    def _slope(self, step: int) -> Joints:
        """Per step: half the way from the step before to the step after; 0 at both ends."""
        if not 0 < step < len(self._steps) - 1:
            return (0.0,) * len(self._steps[0])
        return tuple((b - a) / 2.0 for a, b in zip(self._steps[step - 1], self._steps[step + 1], strict=True))


def program_of(message: dict[str, Any], axes: int) -> tuple[int, OwnProgram]:
    """Number and program of an `own_program` message: `number`, `every_ms`, `joints` (a list for each step).

    Raises Refused.
    """
    number, every_ms, rows = (message.get(key) for key in ("number", "every_ms", "joints"))
    whole = isinstance(number, int) and isinstance(every_ms, int) and 0 < number < 1000 and 0 < every_ms <= 1000
    if not (whole and isinstance(rows, list) and 2 <= len(rows) <= _MOST_STEPS):
        raise Refused("number (1 … 999), every_ms (1 … 1000) and joints (2 … 20000 steps) are expected")
    if not all(isinstance(row, list) and len(row) == axes and all(_is_number(each) for each in row) for row in rows):
        raise Refused(f"each step of joints is a list of {axes} numbers")
    assert isinstance(number, int)
    assert isinstance(every_ms, int)
    return number, OwnProgram([tuple(float(each) for each in row) for row in rows], every_ms * MS)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and isfinite(value)
