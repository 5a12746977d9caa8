"""The telescope and its motors, and its lock on a reflector: followed, for a moment out of the beam, lost."""

from __future__ import annotations

from enum import IntEnum
from math import hypot, radians
from typing import TYPE_CHECKING, final

from sims.geocom._optics import TURN, Direction, Seen, difference, direction_of, offsets
from sims.kernel import Kernel

if TYPE_CHECKING:
    from collections.abc import Callable

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


LOOK_NS = 100_000_000
"""Grid of T on which a lock is looked at."""

REGAIN_RAD = radians(2.0)
"""A reflector that comes back this near to where it was expected is followed on."""


class State(IntEnum):
    """As MOT_ReadLockStatus gives it."""

    NONE = 0
    LOCKED = 1
    PREDICTED = 2


@final
class Lock:
    """Keeps the telescope on one reflector. seen(id): where it is now, None while it cannot be seen.

    changes: looked at every 100 ms; only where they are not the same as before, or say that something moves, the lock
    looks for the reflector.
    """

    def __init__(
        self,
        kernel: Kernel,
        telescope: Telescope,
        seen: Callable[[str], Seen | None],
        changes: Callable[[], tuple[bool, bool, int]],
        predict_ns: int,
    ) -> None:
        self.state = State.NONE
        self.target = ""
        self._kernel = kernel
        self._telescope = telescope
        self._seen = seen
        self._changes = changes
        self._predict_ns = predict_ns
        self._known: tuple[bool, bool, int] | None = None
        self._last: tuple[int, Direction] = (0, telescope.at(0))
        self._rates = (0.0, 0.0)
        self._broken_at = 0
        self._round = 0

    def follow(self, seen: Seen) -> None:
        """Lock onto a reflector."""
        self.release()
        self.state, self.target, self._rates = State.LOCKED, seen.id, (0.0, 0.0)
        self._last = (self._kernel.now, self._towards(seen))
        self._known = None
        self._look_again(self._round)

    def release(self) -> None:
        """Follow nothing from now on."""
        self.state, self.target = State.NONE, ""
        self._round += 1

    def update(self) -> None:
        """Look for the reflector now, and point the telescope at it."""
        if self.state is State.NONE:
            return
        seen = self._seen(self.target)
        if seen is not None and self._is_expected(seen):
            self._take(seen)
        elif self.state is State.LOCKED:
            self.state, self._broken_at = State.PREDICTED, self._kernel.now
        elif self._kernel.now - self._broken_at >= self._predict_ns:
            self._telescope.stop(self._kernel.now)
            self.release()

    def _look_again(self, number: int) -> None:
        grid = (self._kernel.now // LOOK_NS + 1) * LOOK_NS
        self._kernel.at(grid, lambda: self._look(number))

    def _look(self, number: int) -> None:
        if number != self._round:
            return
        changes = self._changes()
        if self.state is State.PREDICTED or changes != self._known or changes[0]:
            self._known = changes
            self.update()
        if self.state is not State.NONE:
            self._look_again(number)

    def _take(self, seen: Seen) -> None:
        now, towards = self._kernel.now, self._towards(seen)
        before_ns, before = self._last
        if now > before_ns and self.state is State.LOCKED:
            seconds = (now - before_ns) * 1e-9
            self._rates = (
                difference(towards.hz, before.hz) / seconds,
                difference(towards.v, before.v) / seconds,
            )
        self.state, self._last = State.LOCKED, (now, towards)
        self._telescope.point(towards, now)

    def _is_expected(self, seen: Seen) -> bool:
        if self.state is State.LOCKED:
            return True
        then, last = self._last
        seconds = (self._kernel.now - then) * 1e-9
        expected = Direction(last.hz + self._rates[0] * seconds, last.v + self._rates[1] * seconds)
        return hypot(*offsets(expected, seen.xyz)) <= REGAIN_RAD

    def _towards(self, seen: Seen) -> Direction:
        return direction_of(seen.xyz, self._telescope.at(self._kernel.now).face)
