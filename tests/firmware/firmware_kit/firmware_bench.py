"""The bench (bench.c) as a process of its own: the firmware in a simulated ATmega328P, stepped by commands."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from pathlib import Path

CLOCK_HZ = 16_000_000
BYTE_CYCLES = 640
"""Ten bits at 250 kbaud."""

CAUSES = {"POWER": 1, "EXTERNAL": 2, "BROWNOUT": 4, "WATCHDOG": 8}
"""A reset's cause → its flag in MCUSR."""


@dataclass(frozen=True, slots=True)
class Event:
    """What the chip did: `tx` (a byte's start bit), `pin`, `irq`, `overrun`, `reset`, at a count of its cycles."""

    kind: str
    cycle: int
    rest: str


class Bench:
    """A chip that has just got its power, at cycle 0. Whatever is asked for a past cycle happens at once."""

    def __init__(self, program: Path, elf: Path) -> None:
        self.cycle = 0
        self._process = subprocess.Popen([program, elf], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def run(self, cycle: int) -> list[Event]:
        """Let the chip run to `cycle`, or an instruction beyond. Returns what it did, in order."""
        self._command(f"run {cycle}")
        events = []
        while (line := self._answer())[0] != "at":
            events.append(Event(line[0], int(line[1]), line[2] if len(line) > 2 else ""))
        self.cycle = int(line[1])
        return events

    def level(self, cycle: int, millivolts: int) -> None:
        """The loop has this voltage from `cycle` on. In order of time."""
        self._command(f"level {cycle} {millivolts}")

    def receive(self, cycle: int, data: bytes) -> None:
        """The host puts `data` on the wire at `cycle`, or behind what it has put there before."""
        for start in range(0, len(data), 1000):
            self._command(f"rx {cycle} {data[start : start + 1000].hex()}")

    def reset(self, cycle: int, cause: str) -> None:
        """POWER, EXTERNAL or BROWNOUT, as a key of CAUSES; for WATCHDOG: `hang`."""
        self._command(f"reset {cycle} {CAUSES[cause]}")

    def hang(self, cycle: int) -> None:
        """The program stands still from `cycle` on, until the watchdog resets the chip."""
        self._command(f"hang {cycle}")

    def bandgap(self, millivolts: int) -> None:
        """The comparator's reference: 1000 to 1200 mV by the data sheet, 1100 unless said."""
        self._command(f"bandgap {millivolts}")

    def host_bit(self, cycles: float) -> None:
        """How long a bit of the host is, in the chip's cycles: 64, if both clocks are right."""
        self._command(f"hostbit {round(cycles * 1000)}")

    def watch(self, vector: int) -> None:
        """Report each entry into this interrupt's routine as an event `irq`."""
        self._command(f"watch {vector}")

    def memory(self, address: int, count: int) -> bytes:
        """Bytes of the data space: registers, and from 0x100 RAM, which is full of 0xA5 at power-on."""
        self._command(f"peek {address:x} {count}")
        return bytes.fromhex(self._answer()[1])

    def timer_base(self) -> int:
        """The cycle at which Timer1 was 0 last."""
        self._command("base")
        return int(self._answer()[1])

    def write(self, address: int, data: bytes) -> None:
        """Write into the data space."""
        self._command(f"poke {address:x} {data.hex()}")

    def close(self) -> None:
        """Switch it off."""
        self._process.communicate()

    def _command(self, line: str) -> None:
        assert self._process.stdin
        self._process.stdin.write(line + "\n")

    def _answer(self) -> list[str]:
        assert self._process.stdin
        assert self._process.stdout
        self._process.stdin.flush()
        line = self._process.stdout.readline().split(maxsplit=2)
        if not line or line[0] == "error":
            raise RuntimeError(f"the bench has ended: {' '.join(line)}")
        return [word.strip() for word in line]
