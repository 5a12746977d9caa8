"""RSI from RSI_ON until it is off: a sensor motion (RSI_MOVECORR), or beside the controller's own programs.

The programmed position follows the program, as it would without RSI. AXISCORR's correction is added to it, through the
servo that a sensor motion has too: 24 ms behind at a constant rate.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, final

from sims.kernel import Event
from sims.krc._rsi_exchange import MS, RsiContext, RsiExchange
from sims.scene.motions import Cycle, Joints, Motion, Standing, State
from sims.simulator import Refused
from sims.world.kinematics import Vector

Ended = Callable[[str], object]
"""Takes the controller's message, empty where all went well."""


class RsiCycles(ABC):
    """From `start` until `abort`, or until it ends by itself: then `on_end` is called."""

    def __init__(self, context: RsiContext, on_end: Ended) -> None:
        self._c = context
        self._on_end = on_end
        self._exchange = RsiExchange(context, len(context.robot.joints()))
        self._next: Event | None = None

    def start(self) -> None:
        """RSI_ON, at a cycle of the grid: the first telegram leaves now."""
        self._exchange.begin()
        self._cycle(first=True)

    def abort(self) -> None:
        """RSI off, at once; the robot may be moving."""
        if self._next:
            self._next.cancel()
        self._exchange.end()

    @abstractmethod
    def _cycle(self, *, first: bool = False) -> None:
        """Take the last answer, move, and send, or end."""

    def _end(self, message: str) -> None:
        self.abort()
        self._on_end(message)

    def _send(self, now: int, end: int) -> None:
        """The telegram of the cycle that ends at `end`, ns; the next one follows then."""
        self._next = self._c.kernel.at(end, self._cycle)
        self._exchange.send(now)


_SETTLED_DEG = 2e-4
_SETTLED_DEG_S = 1e-2


@final
class RsiSession(RsiCycles):
    """Runs from `start` until STOP has ended RSI_MOVECORR and the robot stands, or until something goes wrong.

    `on_end` is called then, with the controller's message, empty where all went well; after trouble the robot is still
    moving and RSI is off. `abort` switches RSI off without a call.
    """

    def __init__(self, context: RsiContext, on_end: Ended) -> None:
        super().__init__(context, on_end)
        self._zero = context.robot.joints()
        self._earlier = self._set_point = self._zero
        self._stopping = False

    def _cycle(self, *, first: bool = False) -> None:
        before = self._set_point
        trouble = "" if first else self._take_answer()
        if trouble:
            self._end(trouble)
            return
        robot = self._c.robot
        state = robot.state()
        if self._stopping and _settled(state.joints, self._set_point) and _slow(state.velocity):
            robot.stand()
            self._end("")
            return
        now = self._c.kernel.now
        end = now + self._c.settings.cycle_ms * MS
        robot.follow_cycle(Cycle(state, self._c.servo.follow(state, before, self._set_point), now, end))
        self._send(now, end)

    def _take_answer(self) -> str:
        """The next set-point by the last telegram's answer; the controller's message or nothing."""
        message = self._exchange.taken(correct=not self._stopping)
        if message or self._stopping:
            return message
        self._stopping = self._exchange.stop
        return self._go_to(tuple(a + b for a, b in zip(self._zero, self._exchange.correction, strict=True)))

    def _go_to(self, set_point: Joints) -> str:
        """The next set-point, unless it is past an axis limit or farther off than the drives can follow."""
        earlier, self._earlier, self._set_point = self._earlier, self._set_point, set_point
        return self._c.past_limit(set_point) or self._c.drives.message(earlier, self._earlier, set_point)


def _settled(joints: Joints, set_point: Joints) -> bool:
    return all(abs(a - b) < _SETTLED_DEG for a, b in zip(joints, set_point, strict=True))


def _slow(velocity: Joints) -> bool:
    return all(abs(v) < _SETTLED_DEG_S for v in velocity)


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


_PATH_SETTLED_DEG = 1e-6
"""A correction this near to its set-point has arrived: a tenth of a micrometre at three metres."""

Begun = Callable[[Joints, int], Motion]
"""Makes the program's motion from the programmed joints, degrees, at a time, ns."""

Then = Callable[[], object]


@final
class PathCorrection(RsiCycles):
    """Runs from `start` to `abort`, or until something goes wrong: then `on_end` is called with the message."""

    def __init__(self, context: RsiContext, on_end: Ended) -> None:
        super().__init__(context, on_end)
        zero = context.robot.joints()
        self._motion: Motion = Standing(zero, context.kernel.now)
        self._earlier = self._before = (0.0,) * len(zero)
        self._corrected = State(self._before, self._before)
        self._scatter: tuple[Vector, Vector] | None = None
        self._waiting: tuple[Begun, Joints, Then] | None = None
        self._then: tuple[Joints, Then] | None = None

    def run(self, begun: Begun, target: Joints, then: Then) -> None:
        """From the next cycle on the program moves to `target`; `then` is called when it is there."""
        self._waiting = begun, target, then

    def _cycle(self, *, first: bool = False) -> None:
        now, robot = self._c.kernel.now, self._c.robot
        message = "" if first else self._exchange.taken()
        arrived = self._arrived(now)
        self._begin(now)
        robot.commanded = self._motion.at(now)
        end = now + self._c.settings.cycle_ms * MS
        after = self._exchange.correction
        message = message or self._c.drives.message(self._earlier, self._before, after)
        corrected = self._settled(self._c.servo.follow(self._corrected, self._before, after), after)
        state = _sum(State(self._motion.at(end), self._motion.velocity(end)), corrected)
        message = message or self._c.past_limit(state.joints)
        if message:
            self._end(message)
            return
        self._move(state, now, end)
        self._earlier, self._before, self._corrected = self._before, after, corrected
        self._send(now, end)
        if arrived:
            arrived()

    def _arrived(self, now: int) -> Then | None:
        """What is to be done as the program's motion ends."""
        if self._then is None or now < self._motion.end_ns:
            return None
        (target, then), self._then = self._then, None
        self._motion, self._scatter = Standing(target, now), None
        return then

    def _begin(self, now: int) -> None:
        if self._waiting is None:
            return
        (begun, target, then), self._waiting = self._waiting, None
        robot = self._c.robot
        self._motion, self._then = begun(self._motion.at(now), now), (target, then)
        self._scatter = robot.scatter_now(), robot.draw(target)

    def _settled(self, state: State, after: Joints) -> State:
        near = all(abs(a - b) < _PATH_SETTLED_DEG for a, b in zip(state.joints, after, strict=True))
        still = after == self._before and max(map(abs, state.velocity)) < 1e-4
        return State(after, (0.0,) * len(after)) if near and still else state

    def _move(self, state: State, now: int, end: int) -> None:
        robot = self._c.robot
        if self._then is None and state == State(robot.joints(), (0.0,) * len(state.joints)):
            if robot.moving:
                robot.stand()
            return
        scatter = None
        if self._scatter:
            share = self._motion.share(end)
            a, b = self._scatter
            scatter = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
        robot.follow_cycle(Cycle(robot.state(), state, now, end), scatter)


def _sum(a: State, b: State) -> State:
    joints, velocity = (
        tuple(x + y for x, y in zip(one, other, strict=True))
        for one, other in ((a.joints, b.joints), (a.velocity, b.velocity))
    )
    return State(joints, velocity)
