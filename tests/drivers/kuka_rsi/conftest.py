"""A controller written by hand, byte by byte, and the cell's time that it owns: what the driver is tested against."""

from __future__ import annotations

import asyncio
import json
import mmap
import re
import selectors
import socket
import struct
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from cellctl.clock import LockstepClock
from cellctl.devices import Address, Surroundings
from drivers.kuka_rsi.description import open_robot

CYCLE_NS = 4_000_000
PATIENCE_S = 120.0
HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)

ETHERNET_XML = """<ROOT>
  <CONFIG>
    <IP_NUMBER>192.168.10.2</IP_NUMBER>
    <PORT>49152</PORT>
    <SENTYPE>CELLCTL</SENTYPE>
    <ONLYSEND>FALSE</ONLYSEND>
  </CONFIG>
  <SEND><ELEMENTS>
      <ELEMENT TAG="DEF_RIst" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_AIPos" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/>
  </ELEMENTS></SEND>
  <RECEIVE><ELEMENTS>
      <ELEMENT TAG="AK.A1" TYPE="DOUBLE" INDX="1" HOLDON="1"/>
      <ELEMENT TAG="AK.A2" TYPE="DOUBLE" INDX="2" HOLDON="1"/>
      <ELEMENT TAG="AK.A3" TYPE="DOUBLE" INDX="3" HOLDON="1"/>
      <ELEMENT TAG="AK.A4" TYPE="DOUBLE" INDX="4" HOLDON="1"/>
      <ELEMENT TAG="AK.A5" TYPE="DOUBLE" INDX="5" HOLDON="1"/>
      <ELEMENT TAG="AK.A6" TYPE="DOUBLE" INDX="6" HOLDON="1"/>
      <ELEMENT TAG="Stop" TYPE="BOOL" INDX="7" HOLDON="0"/>
  </ELEMENTS></RECEIVE>
</ROOT>
"""

RELATIVE_XML = ETHERNET_XML.replace('HOLDON="1"', 'HOLDON="0"')


@dataclass
class Answer:
    """A reply as the controller got it."""

    ipoc: str
    correction: tuple[float, ...]
    stop: bool
    raw: bytes


@dataclass
class FakeController:
    """Owns the cell's time: a telegram waits for its reply, and time for the attached clock every 20 ms.

    Set the fields before a search for bad input; `on_cycle` is called before each telegram with its number. `waits_s`:
    wall time after which a telegram counts as not answered.
    """

    folder: Path
    ipoc: int = 123_456
    ipoc_step: int = 4
    root: str = '<Rob Type="KUKA">'
    silent: bool = False
    follow: float = 0.4
    cycle_ns: int = CYCLE_NS
    relative: bool = False
    message_at: int | None = None
    message: str = "KSS29002 Signal flow (running): Object ETHERNET1 returns error RSIBad"
    unsent: range = range(0)
    burst_at: int | None = None
    delay_counts: bool = False
    on_cycle: Callable[[int], None] = lambda cycle: None
    answers: list[Answer] = field(default_factory=list)
    commands: list[str] = field(default_factory=list)
    joints: list[float] = field(default_factory=lambda: list(HOME))
    program: str = "READY"
    standing_message: str = ""
    garbage: bytes = b""
    move_takes_s: float = 0.2
    halts_ended: int = 0
    waits_s: float = PATIENCE_S

    def __post_init__(self) -> None:
        self.now_ns = 0
        self.eki_silent = False
        self.unanswered = 0
        self.time_file = self.folder / "time"
        self.time_file.write_bytes(bytes(8))
        with self.time_file.open("r+b") as stream:
            self._time = mmap.mmap(stream.fileno(), 8)
        self._ears = selectors.DefaultSelector()
        self.eki_port = self._listen(self._accept_eki)
        self.control_port = self._listen(self._accept_control)
        self._rsi_target = ("127.0.0.1", 0)
        self._eki: socket.socket | None = None
        self._control: socket.socket | None = None
        self._eki_text, self._control_text = b"", b""
        self._tocked_ns = self._ticked_ns = 0
        self._due: list[tuple[int, Callable[[], None]]] = []
        self._over = threading.Event()
        self._rsi: tuple[int, str, list[float]] | None = None
        self._moving: str | None = None
        self._next_stat_ns = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    # what tests do

    def sends_to(self, port: int) -> None:
        self._rsi_target = ("127.0.0.1", port)

    def close(self) -> None:
        self._over.set()
        self._thread.join(5)
        for key in list(self._ears.get_map().values()):
            key.fileobj.close()
        self._ears.close()

    def hang_up(self) -> None:
        self._due.append((self.now_ns, lambda: self._eki and self._eki.shutdown(socket.SHUT_RDWR)))

    def switch_rsi_on_by_hand(self) -> None:
        """Somebody runs the RSI program at the pendant, with no command from the PC."""
        self._due.append((self.now_ns, lambda: self._rsi_on(0)))

    @property
    def in_rsi(self) -> bool:
        return self._rsi is not None

    # time

    def _run(self) -> None:
        while not self._over.is_set():
            self._listen_for(0.0005 if self._control and self._waiting_for_host() else 0)
            if self._waiting_for_host():
                continue
            if self._rsi:
                self._cycle()
            elif self._control or self._eki:
                self._pass_time(5_000_000)
                time.sleep(0.0002)  # noqa: TID251 - the fake has no other clock
            else:
                time.sleep(0.001)  # noqa: TID251

    def _waiting_for_host(self) -> bool:
        if self._control is None or self.now_ns < self._tocked_ns + 20_000_000:
            return False
        if self._ticked_ns < self.now_ns:
            self._ticked_ns = self.now_ns
            with suppress(ConnectionError):  # it hangs up when it likes; the next look at the sockets sees it
                self._control.sendall(json.dumps({"tick": self.now_ns}).encode() + b"\n")
        return True

    def _pass_time(self, ns: int) -> None:
        self.now_ns += ns
        struct.pack_into("=q", self._time, 0, self.now_ns)
        for due in [due for due in self._due if due[0] <= self.now_ns]:
            self._due.remove(due)
            due[1]()
        if self.now_ns >= self._next_stat_ns:
            self._stat()

    def _after(self, seconds: float, do: Callable[[], None]) -> None:
        self._due.append((self.now_ns + round(seconds * 1e9), do))

    # RSI

    def _cycle(self) -> None:
        number, target, offset = self._rsi
        self._pass_time(self.cycle_ns)
        if self._rsi is None:
            return
        cycle = self.cycles
        self.cycles += 1
        self.on_cycle(cycle)
        if self.message_at == cycle:
            self._fault(number)
            return
        self._follow(target, offset)
        self.ipoc += self.ipoc_step
        if self.silent or cycle in self.unsent:
            self.unanswered += 1
            return
        for _ in range(3 if cycle == self.burst_at else 0):
            self._send(self._telegram(self.ipoc))
            self.unanswered += 1
            self.ipoc += self.ipoc_step
            self._pass_time(self.cycle_ns)
        if self.garbage:
            self._send(self.garbage)
        self._send(self._telegram(self.ipoc))
        self._hear(offset)

    def _send(self, telegram: bytes) -> None:
        with suppress(ConnectionRefusedError):  # nobody listens there any more
            self._line.send(telegram)

    def _telegram(self, ipoc: int) -> bytes:
        q = " ".join(f'A{i}="{value:.4f}"' for i, value in enumerate(self.joints, 1))
        count = self.unanswered + len(self.answers) // 100 * self.delay_counts
        late = f'<Delay D="{count}"/>' if self.delay_counts or self.unanswered else ""
        return (
            f'{self.root}<RIst X="1.0" Y="2.0" Z="3.0" A="0.0" B="0.0" C="0.0"/>'
            f"<AIPos {q}/>{late}<IPOC>{ipoc}</IPOC></Rob>"
        ).encode()

    def _hear(self, offset: list[float]) -> None:
        while True:
            try:
                raw = self._line.recv(65535)
            except (TimeoutError, ConnectionRefusedError):
                return
            ipoc = re.search(rb"<IPOC>(.*?)</IPOC>", raw)[1].decode()
            axes = re.search(rb"<AK ([^/]*)/>", raw)[1]
            correction = tuple(float(value) for value in re.findall(rb'A\d="([^"]*)"', axes))
            stop = re.search(rb"<Stop>(.*?)</Stop>", raw)[1] == b"1"
            self.answers.append(Answer(ipoc, correction, stop, raw))
            if ipoc == str(self.ipoc):
                break
        offset[:] = [a + b for a, b in zip(offset, correction, strict=True)] if self.relative else correction
        if stop:
            self._leave()

    def _follow(self, target: list[float], offset: list[float]) -> None:
        for i in range(6):
            self.joints[i] += self.follow * (target[i] + offset[i] - self.joints[i])

    def _leave(self) -> None:
        number, self._rsi, self.program = self._rsi[0], None, "READY"
        self._line.close()
        self._after(0.03, lambda: self._reply(number, 0))

    def _fault(self, number: int) -> None:
        self._rsi, self.program, self.standing_message = None, "ERROR", self.message
        self._line.close()
        self._stat()
        self._reply(number, 31, self.message)

    # EKI

    def _do(self, number: int, operation: str, document: bytes) -> None:
        self.commands.append(operation)
        if operation == "HELLO":
            ident = '<Ident Serial="SIM-000007" Model="KR5 R1400" KSS="8.3.17" Version="1"/>'
            self._reply(number, 0, "", ident)
        elif operation == "RESET":
            self.program, self.standing_message = "READY", ""
            self._reply(number, 0)
        elif operation == "HALT":
            self._halt(number)
        elif self.program == "ERROR":
            self._reply(number, 12, self.standing_message)
        elif self._rsi or self._moving:
            self._reply(number, 10)
        elif operation == "RSI":
            self._rsi_on(number)
            self._reply(number, 1)
        elif operation == "PTP":
            self._move(number, document)

    def _rsi_on(self, number: int) -> None:
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.connect(self._rsi_target)
        self._line.settimeout(self.waits_s)
        self.cycles = 0
        self._rsi, self.program = (number, list(self.joints), [0.0] * 6), "RSI"

    def _move(self, number: int, document: bytes) -> None:
        target = [float(value) for value in re.findall(rb'A\d="([^"]*)"', document)]
        if target[0] > 170:
            self._reply(number, 20, "A1")
            return
        self._moving, self.program = number, "MOVING"

        def arrive() -> None:
            if self._moving == number:
                self._moving, self.program = None, "READY"
                self.joints[:] = target
                self._reply(number, 0)

        self._after(self.move_takes_s, arrive)

    def _halt(self, number: int) -> None:
        stopped = self._rsi[0] if self._rsi else self._moving
        self._rsi = self._moving = None
        self.program = "STOPPED"
        if stopped is not None:
            self._reply(stopped, 30)

        def stand() -> None:
            self.halts_ended += 1
            self._reply(number, 0)

        self._after(0.1, stand)

    def _q(self) -> str:
        return "<Q " + " ".join(f'A{i}="{value:.4f}"' for i, value in enumerate(self.joints, 1)) + "/>"

    def _reply(self, number: int, code: int, text: str = "", more: str = "") -> None:
        self._say(f'<Rep Id="{number}" Code="{code}" Text="{text}">{more}{self._q()}</Rep>')

    def _stat(self) -> None:
        self._next_stat_ns = self.now_ns + 100_000_000
        head = f'<Stat Seq="1" Mode="EXT" Prog="{self.program}" Msg="{self.standing_message}">'
        self._say(f"{head}{self._q()}</Stat>\n")

    def _say(self, text: str) -> None:
        if self._eki and not self.eki_silent:
            data = text.encode()
            with suppress(ConnectionError):
                self._eki.sendall(data[: len(data) // 2])
                self._eki.sendall(data[len(data) // 2 :])

    # sockets

    def _listen(self, accept: Callable[[socket.socket], None]) -> int:
        ear = socket.create_server(("127.0.0.1", 0))
        self._ears.register(ear, selectors.EVENT_READ, lambda: accept(ear.accept()[0]))
        return ear.getsockname()[1]

    def _listen_for(self, seconds: float) -> None:
        for key, _ in self._ears.select(seconds):
            try:
                key.data()
            except ConnectionError:
                self._ears.unregister(key.fileobj)

    def _accept_eki(self, line: socket.socket) -> None:
        self._eki, self._eki_text = line, b""
        self._ears.register(line, selectors.EVENT_READ, self._hear_eki)

    def _accept_control(self, line: socket.socket) -> None:
        self._control, self._tocked_ns = line, self.now_ns
        self._ears.register(line, selectors.EVENT_READ, self._hear_control)

    def _hear_eki(self) -> None:
        data = self._eki.recv(4096)
        if not data:
            self._ears.unregister(self._eki)
            self._eki.close()
            self._eki = self._rsi = self._moving = None
            self.program = "STOPPED"
            return
        self._eki_text += data
        while match := re.match(rb'<Cmd Id="(\d+)" Op="(\w+)">(.*?)</Cmd>', self._eki_text, re.DOTALL):
            self._eki_text = self._eki_text[match.end() :]
            self._do(int(match[1]), match[2].decode(), match[3])

    def _hear_control(self) -> None:
        data = self._control.recv(4096)
        if not data:
            self._ears.unregister(self._control)
            self._control.close()
            self._control = None
            return
        self._control_text += data
        *lines, self._control_text = self._control_text.split(b"\n")
        for line in lines:
            self._tocked_ns = json.loads(line).get("tock", self._tocked_ns)


@pytest.fixture
def controller(tmp_path):
    fake = FakeController(tmp_path)
    yield fake
    fake.close()


@pytest.fixture
def home():
    return HOME


@pytest.fixture
def ethernet_xml():
    return ETHERNET_XML


@pytest.fixture
def relative_xml():
    return RELATIVE_XML


@pytest.fixture
def connected(controller, tmp_path):
    """Opens the robot against the fake controller, on the fake's time."""

    @asynccontextmanager
    async def connect(
        limits: dict[str, float] | None = None, mode: str = "absolute", more: str = ""
    ) -> AsyncIterator[object]:
        (tmp_path / "rsi.xml").write_text(RELATIVE_XML if mode == "relative" else ETHERNET_XML)
        clock = await LockstepClock.attach(str(controller.time_file), "127.0.0.1", controller.control_port)
        address = Address.parse(
            f"kuka+rsi://127.0.0.1:0?ethernet=rsi.xml&eki=127.0.0.1:{controller.eki_port}&mode={mode}{more}"
        )
        robot = open_robot("robot", address, Surroundings(clock, tmp_path, limits or {}))
        try:
            await robot.connect()
            controller.sends_to(robot.listening()[1])
            yield robot
        finally:
            await robot.close()
            await clock.aclose()

    return connect


@pytest.fixture
def run():
    """Runs a coroutine, bounded in wall time."""

    def run_bounded(work):
        async def bounded():
            async with asyncio.timeout(PATIENCE_S):
                return await work

        return asyncio.run(bounded())

    return run_bounded
