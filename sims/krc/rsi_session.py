"""One RSI_ON … RSI_OFF with RSI_MOVECORR: the interpolation cycle of a sensor motion."""

from __future__ import annotations

from typing import final

from sims.krc.rsi_cycles import Ended, RsiCycles
from sims.krc.rsi_exchange import MS, RsiContext
from sims.scene.motions import Cycle, Joints

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
