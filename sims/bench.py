"""A simulated device alone, in the process of a test: time passes only while the test waits for something."""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sims.cell import read_cell
from sims.cell_content import SimCell
from sims.faults import FaultCatalogue, Faults
from sims.kernel import File, Kernel
from sims.memory import Memory
from sims.scene.scene import Scene
from sims.simulator import Setup, Started
from sims.simulators import installed
from sims.wires import Wire


def catalogue() -> FaultCatalogue:
    """All faults, and the events of all simulators."""
    return installed().catalogue(f"{scheme}://" for one in installed().all for scheme in one.schemes)


def setup_of(
    cell: SimCell,
    device: str,
    kernel: Kernel,
    faults: Faults,
    *,
    truth_log: Any = None,
    memory: Memory | None = None,
) -> Setup:
    """For one device of `cell`, in a scene of its own."""
    memory = memory or Memory()
    address = cell.addresses[device]
    simulator = installed().of(address)
    if simulator is None:
        raise LookupError(f"no simulator for '{address}': is its package installed?")
    return Setup(
        device=device,
        address=address,
        settings=cell.simulate.settings.get(simulator.section, {}),
        cell=cell,
        kernel=kernel,
        scene=Scene(kernel, cell, faults, truth_log=truth_log, memory=memory),
        faults=faults,
        wire=Wire(),
        memory=memory,
    )


class Bench:
    """The cell's time, in lockstep with the test, and its faults. The test is the host: it opens the device's place."""

    MOST_TURNS = 100_000

    def __init__(self) -> None:
        self.kernel = Kernel("lockstep")
        self.faults = Faults(self.kernel, catalogue())
        self._started: list[Started] = []

    def start(self, cell_file: Path, device: str) -> Started:
        """Start the simulator of one device of a cell; its address has port or path."""
        cell = read_cell(cell_file)
        simulator = installed().of(cell.addresses[device])
        setup = setup_of(cell, device, self.kernel, self.faults)
        assert simulator
        self._started.append(simulator.start(setup))
        return self._started[-1]

    def until(self, done: Callable[[], object]) -> None:
        """Let time pass until `done()`."""
        self.kernel._heard_at = time.monotonic_ns()  # somebody is there: time need not keep to the wall
        turns = 0
        while not done():
            self.kernel._lockstep_turn()
            turns += 1
            assert turns < self.MOST_TURNS, "what is waited for does not happen"

    def let_pass(self, seconds: float) -> None:
        """Let so much of the cell's time pass."""
        reached: list[bool] = []
        self.kernel.after(round(seconds * 1e9), lambda: reached.append(True))
        self.until(lambda: reached)

    def received(self, line: File, count: int) -> bytes:
        """So many bytes of an open line, or fewer where the device hangs up; time passes until they are there."""
        file = line if isinstance(line, int) else line.fileno()
        data = b""
        while len(data) < count:
            self.until(lambda: select.select([file], [], [], 0)[0])
            piece = os.read(file, count - len(data))
            if not piece:
                break
            data += piece
        return data

    def fault(self, name: str, **settings: Any) -> None:
        """A fault from now on."""
        entry: Mapping[str, Any] = {"fault": name, "at_ms": self.kernel.now / 1e6, **settings}
        self.faults.schedule(self.faults.catalogue.read(entry))
        self.let_pass(0.0)

    def close(self) -> None:
        """End the device, then time."""
        for device in self._started:
            device.close()
        self.kernel.close()
