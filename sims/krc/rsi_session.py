"""One RSI_ON … RSI_OFF: the interpolation cycle with its telegram, answer, correction and motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from sims.faults import Faults
from sims.kernel import Event, Kernel
from sims.krc.drive_monitor import DriveMonitor
from sims.krc.ethernet_config import EthernetConfig
from sims.krc.reply import Reply, read_reply
from sims.krc.rsi_link import RsiLink
from sims.krc.servo import Servo
from sims.krc.signal_flow import AxisCorrection, EthernetOutputs, LateCounter
from sims.krc.telegram import TelegramFormat
from sims.scene.arm import MovingArm
from sims.scene.motions import Cycle, Joints

MS = 1_000_000
LATE = "KSS29002 Signal flow (running): Object ETHERNET1 returns error RSIBad"
OVERALL = "KSS29000 AXISCORR Permissible overall correction exceeded: RSI is stopped"
_SETTLED_DEG = 2e-4
_SETTLED_DEG_S = 1e-2

Ended = Callable[[str], object]


@final
@dataclass(frozen=True, slots=True)
class RsiSettings:
    """Interpolation cycle, decimals of the telegram, tolerated late cycles, and how they count (total, or reset).

    `mode`: what the controller's program passes to RSI_ON, absolute or relative. `hello`: whether HELLO names mode and
    cycle (rsi_on), or not, as in older programs (short).
    """

    cycle_ms: int
    precision: int
    timeout_cycles: int
    counter: str
    mode: str
    hello: str

    @property
    def rsi_on(self) -> tuple[str, str]:
        """What the program passes to RSI_ON: its mode and its cycle, as KRL names them without the #."""
        return self.mode.upper(), "IPO" if self.cycle_ms == 12 else "IPO_FAST"


@final
@dataclass(frozen=True, slots=True)
class RsiContext:
    """What stays the same from one RSI_ON to the next. `limits`: lowest and highest reading of each axis, degrees."""

    kernel: Kernel
    robot: MovingArm
    link: RsiLink
    faults: Faults
    config: EthernetConfig
    telegram: TelegramFormat
    settings: RsiSettings
    late: LateCounter
    servo: Servo
    drives: DriveMonitor
    correction: AxisCorrection
    limits: tuple[tuple[float, float], ...]
    ipoc_offset_ms: int


@final
class RsiSession:
    """Runs from `start` until STOP has ended RSI_MOVECORR and the robot stands, or until something goes wrong.

    `on_end` is called then, with the controller's message, empty where all went well; after trouble the robot is still
    moving and RSI is off. `abort` switches RSI off without a call.
    """

    def __init__(self, context: RsiContext, on_end: Ended) -> None:
        self._c = context
        self._late = context.late
        self._on_end = on_end
        self._wired = context.config.wired
        self._outputs = EthernetOutputs(self._wired)
        self._zero = context.robot.joints()
        self._earlier = self._set_point = self._zero
        self._correction: Joints = (0.0,) * len(self._zero)
        self._stopping = False
        self._ipoc = 0
        self._awaiting = False
        self._older_in_a_row = 0
        self._reply: Reply | None = None
        self._next: Event | None = None

    def start(self) -> None:
        """RSI_ON, at a cycle of the grid: the first telegram leaves now."""
        self._late.begin()
        self._c.link.drain()
        self._c.link.alive()
        self._c.link.on_datagram = self._received
        self._cycle()

    def abort(self) -> None:
        """RSI off, at once; the robot is still moving."""
        if self._next:
            self._next.cancel()
        self._c.link.on_datagram = lambda data: None
        self._c.link.answered()

    def _cycle(self) -> None:
        before = self._set_point
        trouble = self._take_answer()
        if trouble:
            self._end(trouble)
            return
        kernel, robot = self._c.kernel, self._c.robot
        state = robot.state()
        if self._stopping and _settled(state.joints, self._set_point) and _slow(state.velocity):
            robot.stand()
            self._end("")
            return
        now = kernel.now
        end = now + self._c.settings.cycle_ms * MS
        robot.follow_cycle(Cycle(state, self._c.servo.follow(state, before, self._set_point), now, end))
        self._next = kernel.at(end, self._cycle)
        self._send(now)

    def _send(self, now: int) -> None:
        faults, config = self._c.faults, self._c.config
        self._ipoc = self._c.ipoc_offset_ms + now // MS
        self._reply = None
        silent = faults.active("rsi.silent") is not None
        self._awaiting = not silent and not config.only_send
        if not silent and not faults.active("rsi.drop"):
            within_ns = self._c.settings.cycle_ms * MS if self._awaiting else None
            self._c.link.send(self._c.telegram.print(self._ipoc), answer_within_ns=within_ns)

    def _received(self, data: bytes) -> None:
        """A datagram from the PC. One that answers an older telegram does not let T go on: the right one may follow.

        A second one in a row does, or a PC that is always one behind would cost ten seconds of wall time a cycle.
        """
        reply = read_reply(data, self._wired)
        self._older_in_a_row = self._older_in_a_row + 1 if reply and reply.ipoc < self._ipoc else 0
        self._c.link.alive()
        if self._older_in_a_row == 1:
            return
        if not self._c.faults.active("rsi.stall") and reply and self._accepts(reply):
            self._reply = reply
        self._c.link.answered()

    def _accepts(self, reply: Reply) -> bool:
        named = reply.sentype == self._c.config.sentype and not self._c.faults.active("rsi.sentype")
        return named and reply.ipoc == self._ipoc

    def _take_answer(self) -> str:
        """What the last telegram's answer, or its absence, brings about; the controller's message or nothing."""
        if not self._awaiting:
            return ""
        if self._reply:
            self._late.answered()
            self._outputs.answered(self._reply.values)
        else:
            self._outputs.missed()
            if self._late.missed():
                return LATE
        if self._stopping:
            return ""
        self._correction = self._c.correction.after(
            self._correction, [self._outputs[tag] for tag in self._c.config.correction]
        )
        if self._c.correction.exceeded(self._correction):
            return OVERALL
        stop = self._c.config.stop
        self._stopping = stop is not None and self._outputs[stop] != 0.0
        return self._go_to(tuple(zero + angle for zero, angle in zip(self._zero, self._correction, strict=True)))

    def _go_to(self, set_point: Joints) -> str:
        """The next set-point, unless it is past an axis limit or farther off than the drives can follow."""
        earlier, self._earlier, self._set_point = self._earlier, self._set_point, set_point
        return self._past_limit() or self._c.drives.message(earlier, self._earlier, set_point)

    def _past_limit(self) -> str:
        for i, (angle, (low, high)) in enumerate(zip(self._set_point, self._c.limits, strict=True), 1):
            if not low <= angle <= high:
                return f"Software limit switch {'-' if angle < low else '+'}A{i} passed"
        return ""

    def _end(self, message: str) -> None:
        self.abort()
        self._on_end(message)


def _settled(joints: Joints, set_point: Joints) -> bool:
    return all(abs(a - b) < _SETTLED_DEG for a, b in zip(joints, set_point, strict=True))


def _slow(velocity: Joints) -> bool:
    return all(abs(v) < _SETTLED_DEG_S for v in velocity)
