"""Telegram and answer of each cycle of an RSI session: what is sent, which answers are valid, the late counter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from sims.faults import Faults
from sims.kernel import Kernel
from sims.krc.drive_monitor import DriveMonitor
from sims.krc.ethernet_config import EthernetConfig
from sims.krc.reply import Reply, read_reply
from sims.krc.rsi_link import RsiLink
from sims.krc.servo import Servo
from sims.krc.signal_flow import AxisCorrection, EthernetOutputs, LateCounter
from sims.krc.telegram import TelegramFormat
from sims.scene.arm import MovingArm
from sims.scene.motions import Joints

MS = 1_000_000
LATE = "KSS29002 Signal flow (running): Object ETHERNET1 returns error RSIBad"
OVERALL = "KSS29000 AXISCORR Permissible overall correction exceeded: RSI is stopped"


@final
@dataclass(frozen=True, slots=True)
class RsiSettings:
    """Interpolation cycle, decimals of the telegram, tolerated late cycles, and how they count (total, or reset).

    `mode`: what the controller's program passes to RSI_ON, absolute or relative. `hello`: whether HELLO names mode and
    cycle (rsi_on), or not, as in older programs (short). `mark`: whether telegrams have a number of their session.
    `port`: of the next session, kept or new. `restart_cycles`: from a session's end to the next one (rsi.restart).
    """

    cycle_ms: int
    precision: int
    timeout_cycles: int
    counter: str
    mode: str
    mark: str
    port: str
    restart_cycles: int
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

    def past_limit(self, joints: Joints) -> str:
        """The message of an axis past its software limit, or nothing."""
        for i, (angle, (low, high)) in enumerate(zip(joints, self.limits, strict=True), 1):
            if not low <= angle <= high:
                return f"Software limit switch {'-' if angle < low else '+'}A{i} passed"
        return ""


@final
class RsiExchange:
    """From `begin` to `end`: in each cycle first `taken`, then `send`. `correction`: of AXISCORR, degrees."""

    def __init__(self, context: RsiContext, axes: int) -> None:
        self.correction: Joints = (0.0,) * axes
        self._c = context
        self._wired = context.config.wired
        self._outputs = EthernetOutputs(self._wired)
        self._ipoc = 0
        self._awaiting = False
        self._older_in_a_row = 0
        self._reply: Reply | None = None

    def begin(self) -> None:
        """RSI_ON."""
        self._c.late.begin()
        self._c.link.begin(new_port=self._c.settings.port == "new")
        self._c.link.drain()
        self._c.link.alive()
        self._c.link.on_datagram = self._received

    def end(self) -> None:
        """RSI_OFF."""
        self._c.link.on_datagram = lambda data: None
        self._c.link.answered()

    @property
    def stop(self) -> bool:
        """Whether the STOP object's input is set."""
        tag = self._c.config.stop
        return tag is not None and self._outputs[tag] != 0.0

    def send(self, now: int) -> None:
        """The telegram of this cycle."""
        faults, config = self._c.faults, self._c.config
        self._ipoc = self._c.ipoc_offset_ms + now // MS
        self._reply = None
        silent = faults.active("rsi.silent") is not None
        self._awaiting = not silent and not config.only_send
        if not silent and not faults.active("rsi.drop"):
            within_ns = self._c.settings.cycle_ms * MS if self._awaiting else None
            self._c.link.send(self._c.telegram.print(self._ipoc), answer_within_ns=within_ns)

    def taken(self, *, correct: bool = True) -> str:
        """What the last telegram's answer, or its absence, brings about; the controller's message or nothing.

        `correct`: whether the correction follows it.
        """
        if not self._awaiting:
            return ""
        if self._reply:
            self._c.late.answered()
            self._outputs.answered(self._reply.values)
        else:
            self._outputs.missed()
            if self._c.late.missed():
                return LATE
        if not correct:
            return ""
        values = [self._outputs[tag] for tag in self._c.config.correction]
        self.correction = self._c.correction.after(self.correction, values)
        return OVERALL if self._c.correction.exceeded(self.correction) else ""

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
