"""How soon RSI telegrams are answered on a busy machine: our cyclic process beside RSIPI's driver, in one run.

(Four minutes; group `peers`.)

A stand-in for the controller sends a telegram each 4 ms (`--cycle ipo`: 12 ms) to both, half a cycle apart, while two
busy loops run: once with real-time rights for both drivers and once without (CAP_SYS_NICE and CAP_IPC_LOCK taken away;
needs root and setpriv).
The stand-in itself has real-time priority where it may. Where it is late itself, by half a cycle, it leaves telegrams
out, as a controller sends no burst, and says how many. Ours answers a search that moves, or with --online a program of
the controller that it corrects by a model of 448 field nodes and 288 waves; RSIPI's sends zeros. With --online the
durations of the model's part of a cycle are printed too, as counted in the loop process.

`late`: answered after more than a cycle. `skipped`: not answered, as a newer telegram was there already; our process
counts these itself. `none`: telegrams without an answer, the skipped ones among them.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import random
import re
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.kuka_rsi.cyclic.online_block import TIMING_STEP_NS, OnlineSlot, pack
from tests.helpers.krc import wavy_model
from tests.helpers.runs import ROOT, busy_machine

ONLINE = "on-line"
CYCLES_MS = {"ipo_fast": 4, "ipo": 12}
SHARES = {"median": 0.5, "p99": 0.99, "p99.9": 0.999}
START = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
WITHOUT_RIGHTS = ["setpriv", "--bounding-set=-sys_nice,-ipc_lock", "--inh-caps=-sys_nice,-ipc_lock"]
ETHERNET = """<ROOT>
  <CONFIG><IP_NUMBER>127.0.0.1</IP_NUMBER><PORT>{port}</PORT><SENTYPE>CELLCTL</SENTYPE><ONLYSEND>FALSE</ONLYSEND></CONFIG>
  <SEND><ELEMENTS>
    <ELEMENT TAG="DEF_AIPos" TYPE="DOUBLE" INDX="INTERNAL"/><ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/>
  </ELEMENTS></SEND>
  <RECEIVE><ELEMENTS>{corrections}
    <ELEMENT TAG="Stop" TYPE="BOOL" INDX="7" HOLDON="0"/>
  </ELEMENTS></RECEIVE>
</ROOT>"""
AXIS = '<ELEMENT TAG="AKorr.A{i}" TYPE="DOUBLE" INDX="{i}" HOLDON="1"/>'


class Peer:
    """A driver to be asked: its process, and what the stand-in for the controller keeps for it."""

    def __init__(self, name: str, rights: bool, cycle: str) -> None:
        self.name = name
        self._cycle_ms = CYCLES_MS[cycle]
        self._folder = tempfile.TemporaryDirectory()
        ethernet = Path(self._folder.name) / "ethernet.xml"
        port = _free_port()
        ethernet.write_text(ETHERNET.format(port=port, corrections="".join(AXIS.format(i=i) for i in range(1, 7))))
        words = ("rsi_answers", "--cycle", cycle, "--serve", name, str(ethernet))
        command = [*([] if rights else WITHOUT_RIGHTS), sys.executable, "-m", "tests.studies", *words]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT)
        assert self._process.stdout is not None
        self.granted = json.loads(self._process.stdout.readline())
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.connect(("127.0.0.1", port))
        self.line.setblocking(False)
        self.correction = (0.0,) * 6
        self.sent: dict[int, float] = {}
        self.asked = 0
        self.answered = 0
        self.delays_ms: list[float] = []

    def ask(self, ipoc: int) -> None:
        """Send a telegram: a robot that follows what it was last told."""
        swing = 20.0 * math.sin(ipoc / 5000.0) if self.name == ONLINE else 0.0
        program = [angle + swing for angle in START]
        axes = zip(program, self.correction, strict=True)
        joints = " ".join(f'A{i}="{a + b:.4f}"' for i, (a, b) in enumerate(axes, 1))
        programmed = " ".join(f'A{i}="{angle:.4f}"' for i, angle in enumerate(program, 1))
        self.answered = self.answered or ipoc
        delay = max(0, (ipoc - self.answered) // self._cycle_ms - 1)  # cycles left out have no answer either
        telegram = (
            f'<Rob Type="KUKA"><AIPos {joints}/><ASPos {programmed}/><Delay D="{delay}"/><IPOC>{ipoc}</IPOC></Rob>'
        )
        self.sent[ipoc] = time.perf_counter()
        self.line.send(telegram.encode())
        self.asked += 1

    def hear(self) -> None:
        """Take in the answers that are there."""
        now = time.perf_counter()
        while True:
            try:
                answer = self.line.recv(65535).decode()
            except BlockingIOError:
                return
            found = re.search(r"<IPOC>(\d+)</IPOC>", answer)
            began = self.sent.pop(int(found[1]), None) if found else None
            if began is not None:
                self.delays_ms.append((now - began) * 1e3)
                self.answered = max(self.answered, int(found[1]))
            axes = re.findall(r'A\d="([^"]+)"', answer)
            if len(axes) == 6:
                self.correction = tuple(map(float, axes))

    def end(self) -> Answers:
        """End its process; what came of it."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        said = self._process.stdout.read()
        self._process.wait(30)
        self.line.close()
        self._folder.cleanup()
        counts = json.loads(said) if self.name != "RSIPI" else {}
        return Answers(self.name, self._cycle_ms, self.granted, self.asked, tuple(sorted(self.delays_ms)), counts)


@dataclass(frozen=True)
class Answers:
    """What came of asking a driver `asked` times. delays_ms: sorted; counts: by our process itself."""

    name: str
    cycle_ms: int
    granted: dict[str, bool]
    asked: int
    delays_ms: tuple[float, ...]
    counts: dict[str, Any]

    @property
    def late(self) -> int:
        """Answered after more than a cycle."""
        return sum(delay > self.cycle_ms for delay in self.delays_ms)

    @property
    def none(self) -> int:
        """Not answered."""
        return self.asked - len(self.delays_ms)

    def within_ms(self, share: float) -> float:
        """So many of the answers came within this time."""
        return self.delays_ms[min(int(share * len(self.delays_ms)), len(self.delays_ms) - 1)]

    def model_us(self, share: float) -> float:
        """So many of the model's parts of a cycle took at most this time."""
        durations = self.counts["durations"]
        longest = next(i for i in range(len(durations)) if sum(durations[: i + 1]) >= share * sum(durations))
        return (longest + 1) * TIMING_STEP_NS / 1000

    def __str__(self) -> str:
        figures = " ".join(f"{self.within_ms(share):8.3f}" for share in (0.5, 0.99, 0.999, 1.0))
        text = f"{self.name:8} {self.asked:6} {figures} {self.late:6} {self.none:6}   {self.granted}"
        if not self.counts:
            return text
        counted = "{telegrams} telegrams, {skipped} skipped, {late} late answers".format(**self.counts)
        text += f"\n  our process counts {counted}"
        if not sum(self.counts["durations"]):
            return text
        parts = ", ".join(f"{name} {self.model_us(share):g}" for name, share in SHARES.items())
        corrected = "{cycles} cycles corrected, {limited} of them cut by a limit".format(**self.counts)
        return f"{text}\n  model part of a cycle, at most (µs): {parts}; {corrected}"


@contextmanager
def _real_time() -> Iterator[None]:
    """The stand-in has real-time priority meanwhile."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(60))
    except OSError:
        print("the stand-in for the controller has no real-time priority: its own lateness is in the figures")
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _hear_until(due: float, peers: list[Peer]) -> None:
    while (left := due - time.perf_counter()) > 0:
        ready, _, _ = select.select([peer.line for peer in peers], [], [], left)
        for peer in peers:
            if peer.line in ready:
                peer.hear()


def compare(seconds: float, cycle: str, *, rights: bool, ours: str = "cellctl") -> list[Answers]:
    """Ask both for so long beside two busy loops, and print what came of it; first ours."""
    peers = [Peer(ours, rights, cycle), Peer("RSIPI", rights, cycle)]
    cycle_ms = CYCLES_MS[cycle]
    asked = round(seconds * 1e3 / cycle_ms)
    stalls, turn = 0, 0
    with busy_machine(), _real_time():
        start = time.perf_counter() + 0.1
        while turn < 2 * asked:
            due = start + turn * cycle_ms / 2000
            _hear_until(due, peers)
            late_turns = int((time.perf_counter() - due) * 2000 / cycle_ms)
            stalls, turn = stalls + late_turns, turn + late_turns
            peers[turn % 2].ask(1_000_000 + cycle_ms * (turn // 2))
            turn += 1
        _hear_until(time.perf_counter() + 0.2, peers)
    found = [peer.end() for peer in peers]
    print(f"{'with' if rights else 'without'} real-time rights, {seconds:g} s beside two busy loops")
    print(f"  the stand-in for the controller was late itself, and left out {stalls} telegrams")
    print(f"driver    asked   median      p99    p99.9  longest   late   none   granted   (ms; late: > {cycle_ms} ms)")
    print(*found, sep="\n", flush=True)
    return found


def serve(name: str, ethernet: Path, cycle: str) -> None:
    """Be one of the drivers until standard input ends."""
    if name == "RSIPI":
        from RSIPI import RSIAPI

        api = RSIAPI(str(ethernet), rsi_mode="absolute")
        api.start()
        print(json.dumps({}), flush=True)
        sys.stdin.read()
        api.stop()
    else:
        asyncio.run(_serve_ours(ethernet, cycle, corrects=name == ONLINE))


async def _serve_ours(ethernet: Path, cycle: str, *, corrects: bool) -> None:
    from cellctl.devices import Address
    from drivers.kuka_rsi.cyclic.limits import SearchLimits
    from drivers.kuka_rsi.cyclic.session import SearchOrder
    from drivers.kuka_rsi.cyclic.shared_block import GUARDS, Slot
    from drivers.kuka_rsi.cyclic.telegram import ReplyFormat
    from drivers.kuka_rsi.ethernet_config import read_ethernet_config
    from drivers.kuka_rsi.robot.rsi_process import CyclicProcess
    from drivers.kuka_rsi.settings import RsiSettings

    port = re.search(r"<PORT>(\d+)</PORT>", ethernet.read_text())
    assert port is not None
    address = f"kuka+rsi://127.0.0.1:{port[1]}?ethernet={ethernet}&eki=127.0.0.1:54600&correction=AKorr&cycle={cycle}"
    settings = RsiSettings.of(Address.parse(address), ethernet.parent)
    config = read_ethernet_config(settings)
    reply = ReplyFormat.of(config.sentype, config.receive, settings.correction, settings.stop)
    process = await CyclicProcess.start("robot", settings, "wall:0", reply.template, SearchLimits())
    if corrects:
        process.block.online.place_model(_large_model())
        process.block.online.words[OnlineSlot.ORDER] = 1
    far = (4.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    process.block.place_order(SearchOrder(1, START, far, 0.02, (0,) * GUARDS))
    process.block.announce_session(1)
    while process.block.status().number != 1:  # a model with a field imports numpy before the session
        await asyncio.sleep(0.01)
    print(json.dumps(process.granted), flush=True)
    await asyncio.to_thread(sys.stdin.read)
    words, online = process.block.words, process.block.online
    counts: dict[str, Any] = {slot.name.lower(): words[slot] for slot in (Slot.TELEGRAMS, Slot.SKIPPED, Slot.LATE)}
    status = online.status()
    counts |= {"cycles": status.cycles, "limited": status.limited, "durations": online.timing()}
    print(json.dumps(counts), flush=True)
    await process.end()


def _large_model() -> tuple[float, ...]:
    """A model as large as a fit makes: 448 nodes of fields and 288 waves."""
    draw = random.Random(1)
    arrays = wavy_model(0.3)
    for name, count in (("node_place", 6 * 448), ("node_scale", 6 * 448), ("node_weight", 3 * 448)):
        arrays[name] = [draw.uniform(-1.0, 1.0) * (1e-4 if "weight" in name else 1.0) for _ in range(count)]
    arrays["wave_joint"] = [float(joint) for joint in range(6) for _ in range(48)]
    arrays["wave_order"] = [float(order) for _ in range(6) for order in range(1, 49)]
    for name in ("wave_sine", "wave_cosine"):
        arrays[name] = [draw.uniform(-1.0, 1.0) * 1e-6 for _ in range(288)]
    return pack(arrays)


def main(words: Sequence[str]) -> None:
    """Both comparisons."""
    parser = argparse.ArgumentParser("python -m tests.studies rsi_answers", None, __doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--cycle", choices=sorted(CYCLES_MS), default="ipo_fast")
    parser.add_argument("--online", action="store_true", help="ours corrects a program of the controller by a model")
    parser.add_argument("--rights-only", action="store_true", help="without the second comparison")
    parser.add_argument("--serve", nargs=2, metavar=("DRIVER", "ETHERNET"), help=argparse.SUPPRESS)
    asked = parser.parse_args(words)
    if asked.serve:
        serve(asked.serve[0], Path(asked.serve[1]), asked.cycle)
        return
    ours = ONLINE if asked.online else "cellctl"
    compare(asked.seconds, asked.cycle, rights=True, ours=ours)
    if shutil.which("setpriv") and not asked.rights_only:
        compare(asked.seconds, asked.cycle, rights=False, ours=ours)
