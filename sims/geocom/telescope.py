"""The telescope and its motors: where it points at any moment of the cell's time."""

from __future__ import annotations

from math import radians
from typing import final

from sims.geocom.optics import TURN, Direction, difference

SETTLE_NS = 300_000_000
"""From the motors' stop until the angles are steady."""


@final
class Telescope:
    """Points at `at(time_ns)`; moves at a constant rate, rad/s, until a time. speed_deg_s: of both motors."""

    def __init__(self, speed_deg_s: float, start: Direction) -> None:
        self._speed = radians(speed_deg_s)
        self._from = start
        self._since = 0
        self._until: int | None = 0
        self._rates = (0.0, 0.0)

    def at(self, time_ns: int) -> Direction:
        """Its direction then."""
        end = time_ns if self._until is None else min(time_ns, self._until)
        seconds = max(0, end - self._since) * 1e-9
        return Direction(
            (self._from.hz + self._rates[0] * seconds) % TURN, (self._from.v + self._rates[1] * seconds) % TURN
        )

    def point(self, direction: Direction, now_ns: int) -> None:
        """Be there at once: the last hair's breadth of an adjustment, or following a reflector."""
        self._go(direction, (0.0, 0.0), now_ns, now_ns)

    def turn(self, target: Direction, now_ns: int) -> int:
        """Turn the shortest way, both motors together. Returns how long it takes, ns, with settling."""
        start = self.at(now_ns)
        hz, v = difference(target.hz, start.hz), difference(target.v, start.v)
        seconds = max(abs(hz), abs(v)) / self._speed
        if seconds > 0:
            self._go(start, (hz / seconds, v / seconds), now_ns, now_ns + round(seconds * 1e9))
        return round(seconds * 1e9) + SETTLE_NS

    def drive(self, hz_rate: float, v_rate: float, now_ns: int) -> None:
        """Turn at these rates, rad/s, until `stop`; no faster than the motors can."""
        limited = [max(-self._speed, min(self._speed, rate)) for rate in (hz_rate, v_rate)]
        self._go(self.at(now_ns), (limited[0], limited[1]), now_ns, None)

    def stop(self, now_ns: int) -> None:
        """Stand still."""
        self.point(self.at(now_ns), now_ns)

    def _go(self, start: Direction, rates: tuple[float, float], since_ns: int, until_ns: int | None) -> None:
        self._from, self._rates, self._since, self._until = start, rates, since_ns, until_ns
