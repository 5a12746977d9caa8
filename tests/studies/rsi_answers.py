"""How soon RSI telegrams are answered on a busy machine: our cyclic process beside RSIPI's driver, in one run.

    python tests/studies/rsi_answers.py [--seconds 60] [--cycle ipo] [--online] [--rights-only]

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
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests" / "helpers"))

from cell_runs import busy_machine  # noqa: E402 - found by the line above
from online_models import wavy_model  # noqa: E402

from drivers.kuka_rsi.cyclic.model_arrays import pack  # noqa: E402
from drivers.kuka_rsi.cyclic.online_block import TIMING_STEP_NS, OnlineBlock, OnlineSlot  # noqa: E402

ONLINE = "on-line"
CYCLES_MS = {"ipo_fast": 4, "ipo": 12}
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
        command = [sys.executable, __file__, "--cycle", cycle, "--serve", name, str(ethernet)]
        self._process = subprocess.Popen(
            command if rights else [*WITHOUT_RIGHTS, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        assert self._process.stdout is not None
        self.granted = json.loads(self._process.stdout.readline())
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.connect(("127.0.0.1", port))
        self.line.setblocking(False)
        self.correction = (0.0,) * 6
        self.sent: dict[int, float] = {}
        self.asked = 0
        self.delays_ms: list[float] = []

    def ask(self, ipoc: int) -> None:
        """Send a telegram: a robot that follows what it was last told."""
        swing = 20.0 * math.sin(ipoc / 5000.0) if self.name == ONLINE else 0.0
        program = [angle + swing for angle in START]
        axes = zip(program, self.correction, strict=True)
        joints = " ".join(f'A{i}="{a + b:.4f}"' for i, (a, b) in enumerate(axes, 1))
        programmed = " ".join(f'A{i}="{angle:.4f}"' for i, angle in enumerate(program, 1))
        telegram = f'<Rob Type="KUKA"><AIPos {joints}/><ASPos {programmed}/><Delay D="0"/><IPOC>{ipoc}</IPOC></Rob>'
        self.line.send(telegram.encode())
        self.sent[ipoc] = time.perf_counter()
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
            axes = re.findall(r'A\d="([^"]+)"', answer)
            if len(axes) == 6:
                self.correction = tuple(map(float, axes))

    def row(self) -> str:
        """What came of it."""
        delays = sorted(self.delays_ms)
        late = sum(delay > self._cycle_ms for delay in delays)
        at = [delays[min(int(share * len(delays)), len(delays) - 1)] for share in (0.5, 0.99, 0.999)] if delays else []
        figures = " ".join(f"{each:8.3f}" for each in [*at, *delays[-1:]])
        none = self.asked - len(delays)
        return f"{self.name:8} {self.asked:6} {figures} {late:6} {none:6}   {self.granted}"

    def end(self) -> str:
        """End its process; what it says of itself."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        said = self._process.stdout.read().decode()
        self._process.wait(30)
        self.line.close()
        self._folder.cleanup()
        return said


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


def compare(seconds: float, cycle: str, *, rights: bool, ours: str = "cellctl") -> None:
    """Ask both for so long beside two busy loops, and print a row for each."""
    peers = [Peer(ours, rights, cycle), Peer("RSIPI", rights, cycle)]
    cycle_ms = CYCLES_MS[cycle]
    asked = round(seconds * 1e3 / cycle_ms)
    stalls, turn = 0, 0
    with busy_machine():
        start = time.perf_counter() + 0.1
        while turn < 2 * asked:
            due = start + turn * cycle_ms / 2000
            _hear_until(due, peers)
            late_turns = int((time.perf_counter() - due) * 2000 / cycle_ms)
            stalls, turn = stalls + late_turns, turn + late_turns
            peers[turn % 2].ask(1_000_000 + cycle_ms * (turn // 2))
            turn += 1
        _hear_until(time.perf_counter() + 0.2, peers)
    print(f"{'with' if rights else 'without'} real-time rights, {seconds:g} s beside two busy loops")
    print(f"  the stand-in for the controller was late itself, and left out {stalls} telegrams")
    print(
        f"driver    asked   median      p99    p99.9  longest   late   none   granted   (ms; late: after {cycle_ms} ms)"
    )
    for peer in peers:
        print(peer.row(), flush=True)
        print(peer.end(), end="")


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
        asyncio.run(_serve_ours(ethernet, cycle, online=name == ONLINE))


async def _serve_ours(ethernet: Path, cycle: str, *, online: bool) -> None:
    from cellctl.devices import Address
    from drivers.kuka_rsi.cyclic.limits import SearchLimits
    from drivers.kuka_rsi.cyclic.shared_block import GUARDS, Slot
    from drivers.kuka_rsi.cyclic.task import SearchOrder
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
    if online:
        process.block.online.place_model(_large_model())
        process.block.online.words[OnlineSlot.ORDER] = 1
    far = (4.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    process.block.place_order(SearchOrder(1, START, far, 0.02, (0,) * GUARDS))
    process.block.announce_session(1)
    while process.block.status().number != 1:  # a model with a field imports numpy before the session
        await asyncio.sleep(0.01)
    print(json.dumps(process.granted), flush=True)
    await asyncio.to_thread(sys.stdin.read)
    words = process.block.words
    heard, skipped, late = (words[slot] for slot in (Slot.TELEGRAMS, Slot.SKIPPED, Slot.LATE))
    print(f"  our process counts {heard} telegrams, {skipped} skipped, {late} late answers", flush=True)
    if online:
        print(_durations(process.block.online), flush=True)
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


def _durations(online: OnlineBlock) -> str:
    counts, status = online.timing(), online.status()
    total, at = sum(counts), []
    for share in (0.5, 0.99, 0.999):
        longest = next(i for i in range(len(counts)) if sum(counts[: i + 1]) >= share * total)
        at.append(f"{(longest + 1) * TIMING_STEP_NS / 1000:g}")
    what = f"{status.cycles} cycles corrected, {status.limited} of them cut by a limit"
    return f"  model part of a cycle, at most (µs): median {at[0]}, p99 {at[1]}, p99.9 {at[2]}; {what}"


def main() -> None:
    """Both comparisons."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--cycle", choices=sorted(CYCLES_MS), default="ipo_fast")
    parser.add_argument("--online", action="store_true", help="ours corrects a program of the controller by a model")
    parser.add_argument("--rights-only", action="store_true", help="without the second comparison")
    parser.add_argument("--serve", nargs=2, metavar=("DRIVER", "ETHERNET"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.serve:
        serve(asked.serve[0], Path(asked.serve[1]), asked.cycle)
        return
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(60))
    except OSError:
        print("the stand-in for the controller has no real-time priority: its own lateness is in the figures")
    ours = ONLINE if asked.online else "cellctl"
    compare(asked.seconds, asked.cycle, rights=True, ours=ours)
    if shutil.which("setpriv") and not asked.rights_only:
        compare(asked.seconds, asked.cycle, rights=False, ours=ours)


if __name__ == "__main__":
    main()
