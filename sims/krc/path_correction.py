"""RSI beside the controller's own motions (path correction): RSI_ON without RSI_MOVECORR.

The programmed position follows the program, as it would without RSI. AXISCORR's correction is added to it, through the
servo that a sensor motion has too: 24 ms behind at a constant rate.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import final

from sims.krc.rsi_cycles import Ended, RsiCycles
from sims.krc.rsi_exchange import MS, RsiContext
from sims.scene.motions import Cycle, Joints, Motion, Standing, State
from sims.world.screws import Vector

_SETTLED_DEG = 1e-6
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
        near = all(abs(a - b) < _SETTLED_DEG for a, b in zip(state.joints, after, strict=True))
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
