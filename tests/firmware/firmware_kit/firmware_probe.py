"""The probe of a simulated cell is the firmware itself: `contact+firmware:///`, instead of `contact+serial:///`.

The world bends the loop's voltage, the bench runs the firmware as far as the cell's time has come, and the shipped
driver reads its lines from the pseudo-terminal. In lockstep the same seed gives the same bytes; in real time the same
steps are taken by the wall clock.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from firmware_bench import BYTE_CYCLES, CLOCK_HZ, Bench, Event

from sims.kernel import Kernel
from sims.probe import SIMULATOR as SIMULATED
from sims.probe._firmware import Crystal, State
from sims.probe._lines import LineCutter, parse_host_line
from sims.probe._server import Circuit, ProbeServer
from sims.simulator import CannotStart, Setup, Simulator, Started

BUILD = Path(__file__).parents[1] / "build"
POLL_NS = 1_000_000
"""Without an adapter's grid: how often the firmware is asked for what it has sent."""


class FirmwareProbe:
    """The firmware on the bench, behind the cell's time by a poll of the adapter at most.

    What the cell does to it is noted for its exact cycle, and what it has sent is read at the adapter's next poll: so
    nothing comes late.
    """

    def __init__(
        self,
        kernel: Kernel,
        circuit: Circuit,
        seed: int,
        baud: int,
        grid_ns: int,
        deliver: Callable[[bytes, int], object],
    ) -> None:
        self.on_state: Callable[[State], object] = lambda state: None
        self._kernel, self._deliver = kernel, deliver
        self._grid_ns = grid_ns or POLL_NS
        self._hz = CLOCK_HZ * (1 + Crystal.from_seed(seed).drift_ppm * 1e-6)
        self._bench = Bench(BUILD / "bench", BUILD / "contact_probe.elf")
        self._bench.host_bit(self._hz / baud)
        self._bench.level(0, circuit.millivolts)
        self._cutter = LineCutter()
        self._arrived: list[Event] = []
        self._arming: set[int] = set()
        self._edges: set[str] = set()
        circuit.on_change = lambda millivolts: self._bench.level(self._cycle(), millivolts)
        kernel.after(self._grid_ns, self._poll)

    def feed(self, chunk: bytes) -> list[bytes]:
        """The host's characters, over the bench's wire."""
        self._bench.receive(self._cycle(), chunk)
        lines = [line for line, _ in self._cutter.feed(chunk)]
        commands = [command for command in map(parse_host_line, lines) if command]
        self._arming.update(command.seq for command in commands if command.kind == "ARM")
        return lines

    def reset(self, cause: str) -> None:
        """The program hangs until the watchdog bites; any other reset comes at once."""
        if cause == "WATCHDOG":
            self._bench.hang(self._cycle())
        else:
            self._bench.reset(self._cycle(), cause)

    def close(self) -> None:
        """Switch it off."""
        self._bench.close()

    def _cycle(self) -> int:
        return round(self._kernel.now * self._hz / 1e9)

    def _poll(self) -> None:
        for event in self._bench.run(self._cycle()):
            if event.kind == "tx":
                self._arrived.append(event)
            elif event.kind == "reset":
                self._arrived.clear()
        while line := self._line():
            kind, seq, *rest = line.decode("ascii", "replace").split("*")[0].split(",")
            self._announce(kind, rest)
            self._deliver(line, int(seq))
        self._kernel.after(self._grid_ns, self._poll)

    def _line(self) -> bytes:
        """The next whole one that has come over the wire; empty if there is none."""
        data = bytes(int(event.rest, 16) for event in self._arrived)
        length = data.find(b"\n") + 1
        if not length or self._arrived[length - 1].cycle + BYTE_CYCLES > self._bench.cycle:
            return b""
        del self._arrived[:length]
        return data[:length]

    def _announce(self, kind: str, fields: list[str]) -> None:
        if kind == "RE" and fields[-1] == "OK" and int(fields[1]) in self._arming:
            self._arming.clear()
            self.on_state(State.ARMED)
        if kind == "EDGE" and fields[1] not in self._edges:
            self._edges.add(fields[1])
            self.on_state(State.TRIPPED)


def _start(setup: Setup) -> Started:
    if not (BUILD / "bench").exists():
        raise CannotStart(f"{BUILD} has no bench: run `make -C {BUILD.parent}`")
    return ProbeServer(setup, FirmwareProbe)


SIMULATOR = Simulator(
    schemes=("contact+firmware",),
    start=_start,
    section="firmware",
    settings=SIMULATED.settings,
    events=SIMULATED.events,
    address_errors=SIMULATED.address_errors,
)
