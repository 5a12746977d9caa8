"""Telegram and answer of each RSI cycle: the UDP end, valid answers, the late counter, AXISCORR and its monitor."""

from __future__ import annotations

import socket
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, final

from sims.faults import Faults
from sims.kernel import Event, Hold, Kernel
from sims.krc._servo import DriveMonitor, Servo
from sims.krc._telegram import Element, EthernetConfig, Reply, TelegramFormat, read_reply
from sims.scene.arm import MovingArm
from sims.scene.motions import Joints
from sims.simulator import Refused

PEER = "rsi"
_RECEIVE = 65535


def target_of(message: dict[str, Any]) -> tuple[str, int]:
    """Host and port of an `rsi_target` message. Raises Refused."""
    host, port = message.get("host"), message.get("port")
    if not isinstance(host, str) or not isinstance(port, int) or not 0 < port < 0x10000:
        raise Refused("host and port are expected, as 127.0.0.1 and 49152")
    return host, port


@final
class RsiLink:
    """Sends telegrams to the target, passes its datagrams to `on_datagram`, and holds T from `send` to `answered`."""

    def __init__(self, kernel: Kernel) -> None:
        self.on_datagram: Callable[[bytes], object] = lambda data: None
        self._kernel = kernel
        self._socket: socket.socket | None = None
        self._hold: Hold | None = None
        self._target = ("", 0)
        self.sessions = 0
        """RSI_ON so far."""

    @property
    def has_target(self) -> bool:
        """Whether the controller has the PC's address."""
        return self._socket is not None

    def set_target(self, host: str, port: int) -> None:
        """The address of the PC (`<IP_NUMBER>` and `<PORT>` of its configuration)."""
        self.close()
        self._target = host, port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect((host, port))
        self._kernel.watch(self._socket, self._receive)

    def begin(self, *, new_port: bool) -> None:
        """RSI_ON, from the port of the session before, or from a new one."""
        self.sessions += 1
        if new_port and self._socket and self.sessions > 1:
            self.set_target(*self._target)

    def drain(self) -> None:
        """Throw away what has come so far: it belongs to an earlier RSI_ON."""
        callback, self.on_datagram = self.on_datagram, lambda data: None
        self._receive()
        self.on_datagram = callback

    def send(self, telegram: bytes, *, answer_within_ns: int | None) -> None:
        """One telegram; T stands still until `answered`, where an answer is awaited (in real time: for so long)."""
        if self._socket is None:
            return
        self.answered()
        try:
            self._socket.send(telegram)
        except ConnectionRefusedError:  # of an earlier telegram; this one has not left
            with suppress(BlockingIOError, ConnectionRefusedError):
                self._socket.send(telegram)
        if answer_within_ns is not None:
            self._hold = self._kernel.hold_for_answer(PEER, answer_within_ns)

    def answered(self) -> None:
        """The answer has come, or is no longer awaited."""
        if self._hold:
            self._hold.release()
            self._hold = None

    def alive(self) -> None:
        """The PC keeps step: T waits for it."""
        self._kernel.alive(PEER)

    def close(self) -> None:
        """Close the port."""
        self.answered()
        if self._socket:
            self._kernel.unwatch(self._socket)
            self._socket.close()
            self._socket = None

    def _receive(self) -> None:
        while self._socket is not None:
            try:
                data = self._socket.recv(_RECEIVE)
            except BlockingIOError:
                return
            except ConnectionRefusedError:  # no process is bound there: no answer will arrive
                self.answered()
                continue
            self.on_datagram(data)


@final
class EthernetOutputs:
    """The ETHERNET object's outputs that are `wired`, zero at first; a missed answer resets those without HOLDON."""

    def __init__(self, wired: Sequence[Element]) -> None:
        self._values = {element.tag: 0.0 for element in wired}
        self._reset = [element.tag for element in wired if not element.hold_on]

    def __getitem__(self, tag: str) -> float:
        return self._values[tag]

    def answered(self, values: Mapping[str, float]) -> None:
        """A valid answer came; a tag that it left out counts as missed."""
        self.missed()
        self._values.update(values)

    def missed(self) -> None:
        """No valid answer came in this cycle."""
        for tag in self._reset:
            self._values[tag] = 0.0


@final
class LateCounter:
    """Cycles without a valid answer; more than `tolerated` and the ETHERNET object gives up.

    Whether a valid answer resets the count is not published, so both are here: counter `total` never does, `reset`
    does. `count` is what the telegram's Delay shows.
    """

    def __init__(self, tolerated: int, counter: str) -> None:
        self.count = 0
        self._tolerated = tolerated
        self._resets = counter == "reset"

    def begin(self) -> None:
        """RSI_ON: counting begins anew."""
        self.count = 0

    def answered(self) -> None:
        """A cycle with a valid answer."""
        if self._resets:
            self.count = 0

    def missed(self) -> bool:
        """A cycle without one. True where that was one too many."""
        self.count += 1
        return self.count > self._tolerated


@final
class AxisCorrection:
    """AXISCORR and AXISCORRMON: each axis clamped without a word, a greater total stops RSI. Degrees from RSI_ON.

    `relative`: the program's RSI_ON(#RELATIVE), where each cycle's value is added to the correction so far, and the
    clamp holds the sum. What is clamped away is not kept [unconfirmed]: the way back begins at the limit.
    """

    def __init__(self, limit_deg: float = 5.0, monitor_deg: float = 6.0, *, relative: bool = False) -> None:
        self._limit = limit_deg
        self._monitor = monitor_deg
        self._relative = relative

    def after(self, correction: Joints, values: Sequence[float]) -> Joints:
        """The correction one cycle on, with `values` at AXISCORR's inputs."""
        asked = [a + b for a, b in zip(correction, values, strict=True)] if self._relative else values
        limit = self._limit
        return tuple([limit if angle > limit else -limit if angle < -limit else angle for angle in asked])

    def exceeded(self, correction: Joints) -> bool:
        """Whether the overall correction is over its ceiling (KSS29000)."""
        return max(map(abs, correction)) > self._monitor


MS = 1_000_000
LATE = "KSS29002 Signal flow (running): Object ETHERNET1 returns error RSIBad"
OVERALL = "KSS29000 AXISCORR Permissible overall correction exceeded: RSI is stopped"
PAST_LIMIT = "KSS01211 STOP due to software limit switch"
"""Direction and axis follow, -A1."""


@final
@dataclass(frozen=True, slots=True)
class RsiSettings:
    """Interpolation cycle, decimals of the telegram, tolerated late cycles, and how they count (total, or reset).

    `mode`: what the controller's program passes to RSI_ON, absolute or relative. `hello`: whether HELLO names mode and
    cycle (rsi_on), or not, as in older programs (short). `mark`: whether telegrams have a number of their session.
    `port`: of the next session, kept or new. `restart_cycles`: from a session's end to the next one (rsi.restart).
    `jitter_ms`: median delay of a telegram. `lag_ms`: of an axis, None: by `errors.servo`. `t1`: whether the program
    moves in T1, allowed or refused.
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
    jitter_ms: float
    lag_ms: float | None
    t1: str

    @property
    def rsi_on(self) -> tuple[str, str]:
        """What the program passes to RSI_ON: its mode and its cycle, as KRL names them without the #."""
        return self.mode.upper(), "IPO" if self.cycle_ms == 12 else "IPO_FAST"


@final
@dataclass(frozen=True, slots=True)
class RsiContext:
    """What stays the same from one RSI_ON to the next. `limits`: lowest and highest reading of each axis, degrees.

    `delay_ns`: of the next telegram on its way.
    """

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
    delay_ns: Callable[[], int]

    def past_limit(self, joints: Joints) -> str:
        """The message of an axis past its software limit, or nothing."""
        for i, (angle, (low, high)) in enumerate(zip(joints, self.limits, strict=True), 1):
            if not low <= angle <= high:
                return f"{PAST_LIMIT} {'-' if angle < low else '+'}A{i}"
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
        self._late: Event | None = None

    def begin(self) -> None:
        """RSI_ON."""
        self._c.late.begin()
        self._c.link.begin(new_port=self._c.settings.port == "new")
        self._c.link.drain()
        self._c.link.alive()
        self._c.link.on_datagram = self._received

    def end(self) -> None:
        """RSI_OFF."""
        if self._late:
            self._late.cancel()
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
            telegram, delay_ns = self._c.telegram.print(self._ipoc), self._c.delay_ns()
            within_ns = self._c.settings.cycle_ms * MS - delay_ns if self._awaiting else None
            if delay_ns:
                self._late = self._c.kernel.after(
                    delay_ns, lambda: self._c.link.send(telegram, answer_within_ns=within_ns)
                )
            else:
                self._c.link.send(telegram, answer_within_ns=within_ns)

    def taken(self, *, correct: bool = True) -> str:
        """What the last telegram's answer, or its absence, brings about; the controller's message or nothing.

        `correct`: whether the correction follows it.
        """
        if not self._awaiting:  # nothing was sent that could be answered: no late answer, and the outputs stay
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
