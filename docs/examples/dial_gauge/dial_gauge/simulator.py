"""Simulator of the dial gauge: a pseudo-terminal that shows the TCP's height. It shares no code with the driver."""

from __future__ import annotations

import random
from collections.abc import Mapping
from functools import partial

from sims.simulator import FOR_MS, FaultKind, Request, Setting, Setup, Simulator, with_path
from sims.wires import Terminal

ANSWER_NS = 20_000_000
READ, SILENT = "dial_gauge.read", "dial_gauge.silent"


class Gauge:
    """Its tip follows the TCP along the base's z from where it is at the start; its stand drifts.

    What it reads and writes it states to `setup.wire`: the cell's time waits until the host has done the same.
    """

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._draw = random.Random(f"{setup.cell.simulate.seed} {setup.device}")
        self._zero = setup.scene.tcp()[2]
        self._heard, self._received = False, b""
        self._terminal = Terminal(setup.kernel, self._host_speaks, self._host_hangs_up)
        self.address = with_path(setup.address, self._terminal.path)
        self.requests: Mapping[str, Request] = {}

    def close(self) -> None:
        """Hang up."""
        self._terminal.close()
        self._host_hangs_up()

    def _host_speaks(self, data: bytes) -> None:
        if not self._heard:
            self._heard = True
            self._setup.wire.opened()
        *questions, self._received = (self._received + data).split(b"\r")
        for question in questions:
            self._setup.kernel.after(ANSWER_NS, partial(self._answer, question))
        self._setup.wire.read(len(data))

    def _host_hangs_up(self) -> None:
        self._heard, self._received = False, b""
        self._setup.wire.cut()

    def _answer(self, question: bytes) -> None:
        if question == b"?":
            self._setup.faults.announce(READ)
        if self._heard and not self._setup.faults.active(SILENT):
            line = {b"ID?": "SIM-GAUGE-1", b"?": f"{self._reading():+.3f}"}.get(question, "ERR")
            data = f"{line}\r".encode()
            self._setup.wire.wrote(len(data) if self._terminal.write(data) else 0)

    def _reading(self) -> float:
        """The height of the TCP above its height at the start, with drift and noise, mm."""
        minutes = self._setup.kernel.now / 60e9
        drift = self._setup.settings["drift_mm_min"] * minutes
        noise = self._draw.gauss(0.0, self._setup.settings["noise_mm"])
        return float(self._setup.scene.tcp()[2] - self._zero + drift + noise)


SIMULATOR = Simulator(
    schemes=("dial-gauge+serial",),
    start=Gauge,
    section="dial_gauge",
    settings=(
        Setting("noise_mm", "number", 0.001, 0.0, what="1 σ of a reading."),
        Setting("drift_mm_min", "number", 0.0, -1.0, what="Drift of the gauge's stand."),
    ),
    faults=(FaultKind(SILENT, "it answers no more", (FOR_MS,)),),
    events={READ: "a reading is asked for"},
)
