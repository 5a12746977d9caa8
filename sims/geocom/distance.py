"""The distance meter: one measurement at a time, at the reflector in its beam at the end of the measurement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import dist
from typing import final

from sims.geocom.codes import Code
from sims.geocom.optics import Seen, Vector
from sims.geocom.profiles import Profile
from sims.geocom.work import seconds
from sims.kernel import Event, Kernel

STEADY_MM = 1.0
"""A reflector that moves further during a measurement makes it unstable."""


@final
@dataclass(frozen=True, slots=True)
class Measured:
    """A finished measurement: a distance, or the reason why there is none. end_ns: when it ended."""

    code: Code
    mm: float
    end_ns: int
    weak: bool = False


@final
class DistanceMeter:
    """Measures with `seen()`, the reflector in the beam, and `show`, which makes a shown distance of a true one."""

    def __init__(
        self,
        kernel: Kernel,
        profile: Profile,
        seen: Callable[[], Seen | None],
        show: Callable[[Seen], float],
    ) -> None:
        self._kernel = kernel
        self._profile = profile
        self._seen = seen
        self._show = show
        self._ending: Event | None = None
        self._end_ns = 0
        self._began_at: Vector | None = None
        self._tracking = False
        self._result: Measured | None = None

    @property
    def remaining_ns(self) -> int:
        """Until the present measurement ends; 0 where none goes on."""
        return max(0, self._end_ns - self._kernel.now) if self._ending and self._ending.pending else 0

    def start(self, duration_s: float, *, tracking: bool) -> None:
        """Begin a measurement; `tracking`: one after another from then on."""
        self.clear()
        first = self._seen()
        self._began_at = first.xyz if first and not tracking else None
        self._tracking = tracking
        self._end_ns = self._kernel.now + seconds(duration_s)
        self._ending = self._kernel.at(self._end_ns, self._finish)

    def stop(self) -> None:
        """Break off what goes on; a finished distance stays."""
        self._tracking = False
        if self._ending is not None:
            self._ending.cancel()

    def clear(self) -> None:
        """Break off, and forget the distance."""
        self.stop()
        self._result = None

    def result(self) -> Measured | None:
        """The finished measurement, the newest while tracking; None without one."""
        if self._result is not None and self._tracking and self.remaining_ns == 0:
            self._finish()
        return self._result

    def _finish(self) -> None:
        self._result = self._measure()

    def _measure(self) -> Measured:
        now, seen = self._kernel.now, self._seen()
        if seen is None:
            return Measured(Code.TMC_DIST_ERROR, 0.0, now)
        if seen.distance_mm < self._profile.least_mm:
            return Measured(Code.EDM_DIST_TOO_SHORT, 0.0, now)
        if seen.distance_mm > self._profile.most_mm:
            return Measured(Code.EDM_DISTRANGE, 0.0, now)
        if self._began_at is not None and dist(self._began_at, seen.xyz) > STEADY_MM:
            return Measured(Code.EDM_FLUKT, 0.0, now)
        return Measured(Code.OK, self._show(seen), now, seen.weak)
