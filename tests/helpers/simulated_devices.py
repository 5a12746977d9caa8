"""Simulators outside a running cell: what one device's simulator is started with."""

from __future__ import annotations

from sims.faults import Fault, FaultCatalogue, Faults
from sims.kernel import Kernel
from sims.memory import Memory
from sims.scene.scene import Scene
from sims.simulator import Setup
from sims.simulators import installed
from sims.wires import Wire


def catalogue() -> FaultCatalogue:
    """All faults, and the events of all simulators."""
    return installed().catalogue(f"{scheme}://" for one in installed().all for scheme in one.schemes)


def read_fault(entry: dict[str, object]) -> Fault:
    return catalogue().read(entry)


def setup_of(cell, device: str, kernel: Kernel, faults: Faults, *, truth_log=None, memory=None) -> Setup:
    """For one device of `cell`, in a scene of its own."""
    memory = memory or Memory()
    address = cell.addresses[device]
    return Setup(
        device=device,
        address=address,
        settings=cell.simulate.settings[installed().of(address).section],
        cell=cell,
        kernel=kernel,
        scene=Scene(kernel, cell, faults, truth_log=truth_log, memory=memory),
        faults=faults,
        wire=Wire(),
        memory=memory,
    )
