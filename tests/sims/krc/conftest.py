"""A controller on its own wires, and a hand-written PC on the other end: bytes in, bytes out."""

from __future__ import annotations

import io
import json
import re
import select
import socket
import threading
import zlib
from dataclasses import replace
from pathlib import Path

import pytest

from sims.bench import catalogue, setup_of
from sims.cell import ERRORS, read_cell
from sims.faults import Faults
from sims.kernel import Kernel
from sims.krc._controller import start
from sims.world import World
from tests.helpers.sims import read_fault

SHIPPED = read_cell(Path(__file__).parents[3] / "procedures/cells/sphere_cell.yaml")
CELL = replace(SHIPPED, artefact=replace(SHIPPED.artefact, plate=None))
"""Its spheres hang in the air: these robots go wherever a test needs them. What stands there has tests of its own."""
PATIENCE_S = 60.0
PERFECT = dict.fromkeys(ERRORS, 0.0)


class Bench:
    """One simulated controller, its time run by a thread; the test is the PC."""

    def __init__(self, cell, correction, mode, memory):
        self.cell = cell
        self.kernel = Kernel(mode)
        self.faults = Faults(self.kernel, catalogue())
        self.truth = io.StringIO()
        self.changes = []
        setup = setup_of(cell, "robot", self.kernel, self.faults, truth_log=self.truth, memory=memory)
        self.scene, self.loop = setup.scene, setup.scene.contact
        self.loop.subscribe(lambda closed: self.changes.append((self.kernel.now, closed)))
        self.krc = start(setup, correction)
        for fault in cell.simulate.faults:
            self.faults.schedule(fault)
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.settimeout(PATIENCE_S)
        self.krc.set_rsi_target(*self.udp.getsockname())
        self.failure = None
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()
        self.tcp = None
        self.connect()

    def _run(self):
        try:
            self.kernel.run()
        except BaseException as error:
            self.failure = error

    def close(self):
        self.kernel.stop()
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive()
        self.krc.close()
        self.kernel.close()
        self.udp.close()
        self.tcp.close()
        if self.failure:
            raise self.failure

    def let_pass(self, seconds):
        """Until so much of the cell's time has gone by."""
        until, looks = self.kernel.now + seconds * 1e9, 0
        while self.kernel.now < until:
            looks += 1
            assert looks < PATIENCE_S * 100
            threading.Event().wait(0.01)

    def fault(self, **entry):
        """Let a fault begin now, in the cell's own thread; the cell's time then, ns."""
        begun, moments = threading.Event(), []

        def begin():
            moments.append(self.kernel.now)
            self.faults.schedule(read_fault({**entry, "at_ms": self.kernel.now / 1e6}))
            self.kernel.at(self.kernel.now, begun.set)

        self.kernel.at(self.kernel.now, begin)
        assert begun.wait(PATIENCE_S)
        return moments[0]

    def world(self):
        return World(self.cell, self.cell.simulate.seed)

    def connect(self):
        self.tcp = socket.socket()
        self.tcp.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.tcp.settimeout(PATIENCE_S)
        self.tcp.connect(("127.0.0.1", self.krc.eki_port))
        self.stream = b""

    # the transfer channel

    def put(self, text):
        self.tcp.sendall(text.encode())

    def document(self, kind):
        """The next document of a kind (Rep or Stat), others skipped."""
        pattern = re.compile(rf"<{kind} .*?</{kind}>".encode())
        while not (found := pattern.search(self.stream)):
            data = self.tcp.recv(65536)
            assert data, "the controller hung up"
            self.stream += data
        self.stream = self.stream[found.end() :]
        return found.group().decode()

    def reply(self):
        text = self.document("Rep")
        joints = tuple(float(value) for value in re.findall(r'A\d="([^"]*)"', text))
        return re.search(r'Id="([^"]*)"', text)[1], int(re.search(r'Code="(\d+)"', text)[1]), joints, text

    def command(self, op, number=1, inner=""):
        self.put(f'<Cmd Id="{number}" Op="{op}">{inner}</Cmd>')
        return self.reply()

    def ptp(self, target, percent=50.0, number=1):
        return self.command("PTP", number, ptp_body(target, percent))

    def push_row(self, compensated, table_id="ab12"):
        """A table of one row, staged, taken and active."""
        axes = [f"{angle:.6f}" for angle in compensated]
        line = ";".join(["1", *axes, *axes]) + "\n"
        total = f"{zlib.crc32(line.encode()):08X}"
        pair = " ".join(f'A{i}="{angle}"' for i, angle in enumerate(axes, 1))
        serial = re.search(r'Serial="([^"]*)"', self.command("HELLO")[3])[1]
        for op, inner in {
            "TSTAGE": f'<Table Id="{table_id}" Serial="{serial}" Rows="1" Sum="{total}"/>',
            "TBLOCK": f'<Block First="1" Count="1" Sum="{total}"/><R N="1"><Q {pair}/><C {pair}/></R>',
            "TACTIVATE": f'<Table Id="{table_id}" Sum="{total}"/>',
        }.items():
            assert self.command(op, 20, inner)[1] == 0

    def tables(self):
        """Name → Id of the controller's tables."""
        return dict(re.findall(r'<(Active|Previous|Staged) Id="([^"]*)"', self.command("TSTATE")[3]))

    def state(self, wanted):
        """The first state from now on that has all of the wanted words."""
        while not all(word in (text := self.document("Stat")) for word in wanted):
            pass
        return text

    # the sensor channel

    def rsi_on(self, number=7):
        reply = self.command("RSI", number)
        assert reply[:2] == (str(number), 1)

    def telegram(self):
        data, self.robot = self.udp.recvfrom(65535)
        return data.decode()

    def answer(self, telegram, correction=(0.0,) * 6, stop=0, sentype="CELLCTL", ipoc=None):
        ipoc = ipoc_of(telegram) if ipoc is None else ipoc
        axes = " ".join(f'A{i}="{angle:.6f}"' for i, angle in enumerate(correction, 1))
        text = f'<Sen Type="{sentype}"><AK {axes}/><Stop>{stop}</Stop><IPOC>{ipoc}</IPOC></Sen>'
        self.udp.sendto(text.encode(), self.robot)

    def cycles(self, count, correction=(0.0,) * 6, **how):
        """Take and answer so many telegrams, with a fixed correction or a function of the cycle's number."""
        telegrams = []
        for i in range(count):
            telegrams.append(self.telegram())
            self.answer(telegrams[-1], correction(i) if callable(correction) else correction, **how)
        return telegrams

    def ramp(self, correction, cycles=40):
        """Smoothly to a correction, so that the drives can follow, and one cycle more; the last telegram."""
        shares = [share * share * (3.0 - 2.0 * share) for share in ((i + 1) / cycles for i in range(cycles))]
        self.cycles(cycles, lambda i: tuple(shares[i] * angle for angle in correction))
        return self.cycles(2, correction)[-1]

    def until_reply(self, correction=(0.0,) * 6, stop=0):
        """Answer telegrams until the controller replies on the transfer channel; that reply."""
        cycle = 0
        while b"</Rep>" not in self.stream:
            ready, _, _ = select.select([self.udp, self.tcp], [], [], PATIENCE_S)
            assert ready, "neither telegram nor reply"
            if self.tcp in ready:
                data = self.tcp.recv(65536)
                assert data, "the controller hung up"
                self.stream += data
            if self.udp in ready:
                self.answer(self.telegram(), correction(cycle) if callable(correction) else correction, stop)
                cycle += 1
        return self.reply()

    def finish(self, correction=(0.0,) * 6):
        """Raise the stop tag and answer until RSI is off; the command's last reply."""
        return self.until_reply(correction, stop=1)

    def truth_lines(self):
        return [json.loads(line) for line in self.truth.getvalue().splitlines()]


def ptp_body(target, percent=50.0):
    axes = " ".join(f'A{i}="{angle:.4f}"' for i, angle in enumerate(target, 1))
    return f'<Vel P="{percent}"/><Q {axes}/>'


def ipoc_of(telegram):
    return int(re.search(r"<IPOC>(\d+)</IPOC>", telegram)[1])


@pytest.fixture
def bench():
    """Start a controller: `bench(errors={…}, rsi={…}, faults=[…], cell=…)`; all errors off unless named."""
    benches = []

    def begin(
        errors=None, rsi=None, faults=(), cell=CELL, ethernet=None, correction=None, mode="lockstep", memory=None
    ):
        simulate = replace(
            cell.simulate,
            errors={**PERFECT, **(errors or {})},
            settings={**cell.simulate.settings, "rsi": {**cell.simulate.settings["rsi"], **(rsi or {})}},
            faults=tuple(read_fault(fault) for fault in faults),
        )
        if ethernet is not None:
            address = f"kuka+rsi://127.0.0.1:0?ethernet={ethernet.name}"
            cell = replace(cell, path=ethernet.parent / "cell.yaml", addresses={"robot": address})
        benches.append(Bench(replace(cell, simulate=simulate), correction, mode, memory))
        return benches[-1]

    yield begin
    for one in benches:
        one.close()
