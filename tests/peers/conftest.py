"""A controller side that we did not write: RSIPI's EchoServer for RSI, and a few lines of EKI that start and end it.

The EchoServer's own log says which answers it took; nothing stands between it and our driver on the wire. Its quirks:
it binds UDP port 50000, writes two decimals, ends itself after more faulty answers than its budget, and knows neither
the stop nor the end of RSI: the stand-in for EKI ends it when its log shows the stop. Its ASPos follows the correction,
which a controller's does not, so it sends none.
"""

from __future__ import annotations

import asyncio
import fcntl
import importlib.util
import re
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, Surroundings
from drivers.kuka_rsi.description import open_robot
from tests.helpers.runs import unhurried

ECHO_PORT = 50000
SENTYPE = "CELLCTL"
PATIENCE_S = 120.0

ETHERNET_XML = """<ROOT>
  <CONFIG>
    <IP_NUMBER>127.0.0.1</IP_NUMBER>
    <PORT>{port}</PORT>
    <SENTYPE>{sentype}</SENTYPE>
    <ONLYSEND>FALSE</ONLYSEND>
  </CONFIG>
  <SEND><ELEMENTS>
      <ELEMENT TAG="DEF_RIst" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_AIPos" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_MACur" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/>
  </ELEMENTS></SEND>
  <RECEIVE><ELEMENTS>
{corrections}
      <ELEMENT TAG="Stop" TYPE="BOOL" INDX="7" HOLDON="0"/>
  </ELEMENTS></RECEIVE>
</ROOT>
"""


ECHO = """
import sys, time
from RSIPI.rsi_echo_server import EchoServer
mode, cycle_ms, packets = sys.argv[1:]
server = EchoServer("rsi.xml", int(cycle_ms), mode, timeout_packets=int(packets))
server.state["Tech"] = {"C21": 7.0, "C22": -7.0}
server.start()
while server.running:
    time.sleep(0.1)
"""
"""With the mark of a session: its Delay counts lost answers only once it hears the PC again, unlike a controller's."""


def ethernet_xml(port: int, mode: str, sentype: str = SENTYPE) -> str:
    hold = {"absolute": 1, "relative": 0}[mode]
    tags = (f'<ELEMENT TAG="AKorr.A{i}" TYPE="DOUBLE" INDX="{i}" HOLDON="{hold}"/>' for i in range(1, 7))
    return ETHERNET_XML.format(port=port, sentype=sentype, corrections="\n".join(f"      {tag}" for tag in tags))


@dataclass
class Taken:
    """An answer that the EchoServer took, as its log has it."""

    correction: tuple[float, ...]
    stop: bool


@dataclass
class ForeignController:
    """EKI by hand, RSI by the EchoServer. `mode`, `sentype`: what the EchoServer is started with."""

    folder: Path
    mode: str
    cycle_ms: int
    sentype: str = SENTYPE
    timeout_packets: int = 1_000_000
    rsi_port: int = 0
    commands: list[str] = field(default_factory=list)
    joints: tuple[float, ...] = (0.0,) * 6
    program: str = "READY"
    message: str = ""

    def __post_init__(self) -> None:
        self._echo: asyncio.subprocess.Process | None = None
        self._watching: asyncio.Task[None] | None = None
        self._searching = 0
        self._eki: asyncio.StreamWriter | None = None
        self._taken: list[Taken] = []
        self._log_read = 0

    # what tests do and look at

    @property
    def said(self) -> str:
        """What the EchoServer printed since RSI was last switched on."""
        return self._path("printed").read_text()

    def taken(self) -> list[Taken]:
        """The answers that the EchoServer took since RSI was last switched on."""
        log = self._path("logs/echo_server.log")
        data = log.read_bytes()[self._log_read :] if log.exists() else b""
        text = data[: data.rfind(b"\n") + 1]
        self._log_read += len(text)
        answers = re.findall(r"Processed input: (<Sen .*</Sen>)\n", text.decode())
        self._taken += [Taken(_axes(answer), "<Stop>1</Stop>" in answer) for answer in answers]
        return self._taken

    def offset(self) -> tuple[float, ...]:
        """Offset of A1…A6 that the answers taken make, degrees."""
        corrections = [taken.correction for taken in self.taken()] or [(0.0,) * 6]
        return corrections[-1] if self.mode == "absolute" else tuple(map(sum, zip(*corrections, strict=True)))

    async def has_gone(self, degrees: float) -> None:
        """Wait until A2 is corrected by that much."""
        async with asyncio.timeout(PATIENCE_S):
            while self.offset()[1] < degrees:
                await asyncio.sleep(0.02)

    def freeze(self) -> None:
        """The EchoServer falls silent and stays so, its port bound, with no word from the controller about it."""
        self._echo.send_signal(signal.SIGSTOP)

    # EKI

    async def talk(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._eki = writer
        reporting = asyncio.create_task(self._report())
        text = b""
        with suppress(ConnectionError):
            while data := await reader.read(4096):
                text += data
                while match := re.match(rb'<Cmd Id="(\d+)" Op="(\w+)">(.*?)</Cmd>', text, re.DOTALL):
                    text = text[match.end() :]
                    await self._do(int(match[1]), match[2].decode(), match[3].decode())
        reporting.cancel()
        await self._rsi_off()
        writer.close()

    async def _report(self) -> None:
        while True:
            self._stat()
            await asyncio.sleep(0.1)

    def _stat(self) -> None:
        self._say(f'<Stat Seq="1" Mode="EXT" Prog="{self.program}" Msg="{self.message}">{self._q()}</Stat>')

    async def _do(self, number: int, operation: str, content: str) -> None:
        self.commands.append(operation)
        if operation == "RSI":
            await self._rsi_on(number)
            return
        if operation == "HALT":
            await self._rsi_off()
            if self._searching:
                self._reply(self._searching, 30)
            self._searching, self.program = 0, "STOPPED"
        elif operation == "PTP":
            self.joints = _axes(content)
        elif operation == "RESET":
            self.program, self.message = "READY", ""
        self._reply(number, 0, more='<Ident Serial="SIM-RSIPI" Model="EchoServer" KSS="0.3.0" Version="1"/>')

    def _reply(self, number: int, code: int, text: str = "", more: str = "") -> None:
        self._stat()  # the reply follows a change of state, if there was one
        self._say(f'<Rep Id="{number}" Code="{code}" Text="{text}">{more}{self._q()}</Rep>')

    def _q(self) -> str:
        return "<Q " + " ".join(f'A{i}="{value:.4f}"' for i, value in enumerate(self.joints, 1)) + "/>"

    def _say(self, text: str) -> None:
        self._eki.write(text.encode())

    # RSI

    async def _rsi_on(self, number: int) -> None:
        """The EchoServer's axes stand at zero when it starts."""
        assert self.joints == (0.0,) * 6
        self._path("rsi.xml").write_text(ethernet_xml(self.rsi_port, self.mode, self.sentype))
        self._path("logs/echo_server.log").unlink(missing_ok=True)
        self._taken, self._log_read = [], 0
        command = [sys.executable, "-u", "-c", ECHO, self.mode, str(self.cycle_ms), str(self.timeout_packets)]
        with self._path("printed").open("wb") as printed:
            self._echo = await asyncio.create_subprocess_exec(
                *command, cwd=self._path("."), stdout=printed, stderr=asyncio.subprocess.STDOUT
            )
        async with asyncio.timeout(PATIENCE_S):
            while "started" not in self.said:
                assert self._echo.returncode is None, self.said
                await asyncio.sleep(0.01)
        self._searching, self.program = number, "RSI"
        self._reply(number, 1)
        self._watching = asyncio.create_task(self._watch(number))

    async def _watch(self, number: int) -> None:
        """RSI is over when the stop was taken, or when the EchoServer broke it off."""
        while "BROKE OFF" not in self.said and not any(taken.stop for taken in self.taken()[-50:]):
            await asyncio.sleep(0.01)
        self._watching = None
        await self._rsi_off()
        self._searching = 0
        if "BROKE OFF" in self.said:
            self.program, self.message = "ERROR", "KSS29002 Object ETHERNET1 returns error RSIBad"
            self._reply(number, 31, self.message)
        else:
            self.program = "READY"
            self._reply(number, 0)

    async def _rsi_off(self) -> None:
        if self._watching:
            self._watching.cancel()
            self._watching = None
        if self._echo:
            with suppress(ProcessLookupError):
                self._echo.kill()
            await self._echo.wait()
            self._echo, self.joints = None, self.offset()

    def _path(self, name: str) -> Path:
        return self.folder / "controller" / name


def _axes(text: str) -> tuple[float, ...]:
    return tuple(float(re.search(rf'A{i}="([^"]*)"', text)[1]) for i in range(1, 7))


@pytest.fixture
def echo_port():
    """The EchoServer's fixed port, for this test alone; skips where RSIPI is not installed or the port is not free."""
    if importlib.util.find_spec("RSIPI") is None:
        pytest.skip("RSIPI is not installed (dependency group 'peers')")
    with (Path(tempfile.gettempdir()) / f"cellctl-peers-{ECHO_PORT}.lock").open("w") as lock:
        _wait_for(lock)
        try:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
                line.bind(("0.0.0.0", ECHO_PORT))
        except OSError:
            pytest.skip(f"UDP port {ECHO_PORT}, which RSIPI's EchoServer binds, is taken by another program")
        yield ECHO_PORT


def _wait_for(lock) -> None:
    """Another worker of the same run may hold it for a few tests."""
    for _ in range(2000):
        with suppress(BlockingIOError):
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        threading.Event().wait(0.05)
    pytest.skip(f"UDP port {ECHO_PORT} is in use by another run of these tests")


@pytest.fixture
def foreign(tmp_path, echo_port, monkeypatch):
    """Opens our robot against the foreign controller. What is shown is the wire, not how steadily this machine runs."""
    unhurried(monkeypatch)

    @asynccontextmanager
    async def connect(address_mode: str, cycle_ms: int, **controller_has: object) -> AsyncIterator[object]:
        (tmp_path / "controller").mkdir()
        (tmp_path / "rsi.xml").write_text(ethernet_xml(49152, address_mode))
        controller = ForeignController(tmp_path, **{"mode": address_mode, "cycle_ms": cycle_ms, **controller_has})
        server = await asyncio.start_server(controller.talk, "127.0.0.1", 0)
        port = server.sockets[0].getsockname()[1]
        cycle = "ipo" if cycle_ms == 12 else "ipo_fast"
        address = f"kuka+rsi://127.0.0.1:0?ethernet=rsi.xml&eki=127.0.0.1:{port}&correction=AKorr"
        address += f"&mode={address_mode}&cycle={cycle}"
        robot = open_robot("robot", Address.parse(address), Surroundings(WallClock(), tmp_path))
        try:
            await robot.connect()
            controller.rsi_port = robot.listening()[1]
            yield robot, controller
        finally:
            await robot.close()
            server.close()
            await controller._rsi_off()

    return connect


@pytest.fixture
def run():
    """Runs a coroutine, bounded in wall time."""

    def run_bounded(work):
        async def bounded():
            async with asyncio.timeout(2 * PATIENCE_S):
                return await work

        return asyncio.run(bounded())

    return run_bounded
