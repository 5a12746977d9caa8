"""The simulated probe put together: loop circuit, firmware, wire, terminal, and its share of the faults."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Protocol, final

from sims.faults import Faults
from sims.kernel import Event, Hold, Kernel
from sims.probe._firmware import Crystal, Firmware, State
from sims.probe._lines import ARM, CONTACT, HostLine, Receiver, Transmitter, baud_of, parse_host_line
from sims.scene.contact import ContactLoop
from sims.simulator import Refused, Request, Setup, with_path
from sims.wires import Terminal

CLOSED_MV = 40
OPEN_MV = 1650
BROKEN_MV = 4950

BOUNCE_NS = (50_000, 1_000_000)
"""Between these after the edge a contact opens and closes again."""


BY_HAND_NS = 300_000_000
"""So long a touch by hand lasts."""


def bounce_delays(draw: random.Random, edges: int) -> list[int]:
    """When the further edges of a contact come, ns after the first."""
    return sorted(draw.sample(range(*BOUNCE_NS), edges))


@final
class Circuit:
    """Turns the loop and its faults into a voltage; `on_change(millivolts)` at the exact time of each change."""

    def __init__(self, kernel: Kernel, loop: ContactLoop, faults: Faults, seed: int, bounce: int) -> None:
        self.on_change: Callable[[int], object] = lambda millivolts: None
        self._kernel = kernel
        self._faults = faults
        self._bounce = bounce
        self._draw = random.Random(f"{seed} bounce")
        self._touching = loop.closed
        self._bouncing: list[Event] = []
        self.millivolts = self._voltage()
        loop.subscribe(self._contact)
        for name in ("probe.closed", "probe.wire_break", "probe.no_contact"):
            faults.on_start(name, self._settle)
            faults.on_end(name, self._settle)

    def touch_by_hand(self, action: object) -> None:
        """Somebody touches the tip with a wire, and lets go. Raises Refused for anything else."""
        if action != "touch":
            raise Refused("by hand the probe is touched: action touch")
        self._contact(True)
        self._kernel.after(BY_HAND_NS, lambda: self._contact(False))

    def _contact(self, closed: bool) -> None:
        for event in self._bouncing:
            event.cancel()
        self._bouncing = [self._kernel.after(delay, self._toggle) for delay in bounce_delays(self._draw, self._bounce)]
        self._touching = closed
        self._settle()

    def _toggle(self) -> None:
        self._touching = not self._touching
        self._settle()

    def _settle(self) -> None:
        millivolts = self._voltage()
        if millivolts != self.millivolts:
            self.millivolts = millivolts
            self.on_change(millivolts)

    def _voltage(self) -> int:
        if self._faults.active("probe.wire_break"):
            return BROKEN_MV
        if self._faults.active("probe.closed"):
            return CLOSED_MV
        touching = self._touching and not self._faults.active("probe.no_contact")
        return CLOSED_MV if touching else OPEN_MV


REBOOT_NS = 300_000_000
PEER = "probe"

_NAME = "SIM contact probe"
EVENTS = {State.ARMED: ARM, State.TRIPPED: CONTACT}
"""What is announced when the probe comes into a state."""


class Watcher(Protocol):
    """What the server needs of the microcontroller with its wires."""

    on_state: Callable[[State], object]

    def feed(self, chunk: bytes) -> list[bytes]:
        """Characters from the host. Returns the lines that they complete, though the probe has yet to hear them."""

    def reset(self, cause: str) -> None:
        """Everything is lost; the probe is back after its boot loader's time."""

    def close(self) -> None:
        """Switch it off."""


@final
class Probe:
    """The microcontroller with its wires: fed with characters, it gives lines to `deliver(line, seq)`."""

    def __init__(
        self,
        kernel: Kernel,
        circuit: Circuit,
        seed: int,
        baud: int,
        grid_ns: int,
        deliver: Callable[[bytes, int], object],
        crystal: Crystal | None = None,
    ) -> None:
        self._kernel = kernel
        self._circuit = circuit
        self._serial = f"SIM-{seed:06d}"
        self._crystal = crystal or Crystal.from_seed(seed)
        self._transmitter = Transmitter(kernel, baud, grid_ns, lambda: self._crystal.tick(kernel.now), deliver)
        self._receiver = Receiver(kernel, baud, lambda line: self._update([parse_host_line(line)]))
        self._wake: Event | None = None
        self._firmware: Firmware | None = None
        self.on_state: Callable[[State], object] = lambda state: None
        circuit.on_change = lambda millivolts: self._update([])
        self._boot("POWER")

    def feed(self, chunk: bytes) -> list[bytes]:
        """Characters from the host. Returns the lines that they complete, though the probe has yet to hear them."""
        return self._receiver.feed(chunk)

    def reset(self, cause: str) -> None:
        """Everything is lost; the probe is back after its boot loader's time."""
        self._firmware = None
        self._transmitter.cut()
        self._crystal = self._crystal.restarted(self._kernel.now)
        self._sleep_until(self._kernel.now + REBOOT_NS, lambda: self._boot(cause))

    def close(self) -> None:
        """It has nothing that would have to be let go."""

    def _boot(self, cause: str) -> None:
        now = self._kernel.now
        self._firmware = Firmware(_NAME, self._serial, cause, self._crystal, now, self._circuit.millivolts)
        self._update([])

    def _update(self, lines: list[HostLine | None]) -> None:
        if self._firmware is None:
            return
        before = self._firmware.state
        for message in self._firmware.update(self._kernel.now, self._circuit.millivolts, lines):
            self._transmitter.send(message)
        if self._firmware.state is not before:
            self.on_state(self._firmware.state)
        self._sleep_until(self._firmware.wake_at, lambda: self._update([]))

    def _sleep_until(self, time_ns: int, action: Callable[[], object]) -> None:
        if self._wake is not None:
            self._wake.cancel()
        self._wake = self._kernel.at(time_ns, action)


@final
class ProbeServer:
    """The probe on its pseudo-terminal. In lockstep each line that arrives holds T until the host acknowledges it.

    `build` takes the place of `Probe`, with its arguments and methods: another program that watches the loop.
    """

    def __init__(self, setup: Setup, build: Callable[..., Watcher] = Probe) -> None:
        kernel, faults, seed = setup.kernel, setup.faults, setup.cell.simulate.seed
        self._kernel = kernel
        self._faults = faults
        self._held: dict[int, Hold] = {}
        self._heard = False
        self._lines_to_damage = 0
        self._wire = setup.wire
        self._terminal = Terminal(kernel, self._host_speaks, self._host_hangs_up)
        self.address = with_path(setup.address, self._terminal.path)
        circuit = Circuit(kernel, setup.scene.contact, faults, seed, setup.settings["bounce"])
        grid_ns = round(setup.settings["usb_delay_ms"] * 1e6)
        self._probe = build(kernel, circuit, seed, baud_of(setup.address), grid_ns, self._deliver)
        self.requests: dict[str, Request] = {"by_hand": lambda message: circuit.touch_by_hand(message.get("action"))}
        self._probe.on_state = lambda state: faults.announce(EVENTS[state]) if state in EVENTS else None
        faults.on_start("probe.reset", lambda: self._probe.reset("WATCHDOG"))

    @property
    def path(self) -> str:
        """The terminal that a host opens: `/dev/pts/7`."""
        return self._terminal.path

    def close(self) -> None:
        """Hang up."""
        self._probe.close()
        self._terminal.close()
        self._host_hangs_up()

    def _deliver(self, line: bytes, seq: int) -> None:
        if self._faults.active("probe.silent"):
            return
        if self._is_damaged():
            # nobody can acknowledge what nobody can read: T goes on
            self._write(_damaged(line))
        elif self._write(line) and self._heard:
            self._hold(seq)

    def _write(self, line: bytes) -> bool:
        written = self._terminal.write(line)
        self._wire.wrote(len(line) if written else 0)
        return written

    def _is_damaged(self) -> bool:
        fault = self._faults.active("probe.corrupt")
        if fault is None:
            return False
        self._lines_to_damage = (self._lines_to_damage + 1) % fault.settings["every"]
        return self._lines_to_damage == 0

    def _host_speaks(self, chunk: bytes) -> None:
        if not self._heard:
            self._heard = True
            self._wire.opened()
        self._kernel.alive(PEER)
        for line in self._probe.feed(chunk):
            said = parse_host_line(line)
            if said is not None and said.kind == "ACK":
                self._release(said.seq)
        self._wire.read(len(chunk))

    def _host_hangs_up(self) -> None:
        self._heard = False
        self._held.clear()
        self._wire.cut()
        self._kernel.forget(PEER)

    def _hold(self, seq: int) -> None:
        self._release(seq)
        hold = self._kernel.hold(PEER)
        if hold.active:
            self._held[seq] = hold

    def _release(self, seq: int) -> None:
        hold = self._held.pop(seq, None)
        if hold is not None:
            hold.release()


def _damaged(line: bytes) -> bytes:
    """The line with one bit of its middle character turned over."""
    middle = len(line) // 2
    return line[:middle] + bytes([line[middle] ^ 1]) + line[middle + 1 :]
