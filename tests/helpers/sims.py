"""Simulators outside a running cell: what one device's simulator is started with, and the world that it is in.

The world is the shipped sphere cell's, with only those errors that a test switches on. `search_until_contact` searches
along A1 on the wires of the simulated controller. A `TcpBench` is a simulated device on its own port; the test is a
client that writes bytes by hand, and lets time pass meanwhile.
"""

from __future__ import annotations

import socket
from dataclasses import replace
from math import atan2, cos, degrees, hypot, radians, sin
from pathlib import Path

import numpy as np

from sims.bench import Bench, catalogue
from sims.cell import ERRORS, read_cell
from sims.faults import Fault
from sims.world import World

CELL = read_cell(Path(__file__).parents[2] / "procedures/cells/sphere_cell.yaml")
BENT = (10.0, -80.0, 85.0, 20.0, 40.0, 30.0)
"""Readings of a pose without any symmetry, deg."""

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
STEP_DEG = 0.004
"""Of A1 in a cycle: 1 deg/s."""
TOUCH_MM = 61.4 / 2 + 0.6
"""From the sphere's centre to that of the tip in contact."""

PATIENCE_S = 60.0


def read_fault(entry: dict[str, object]) -> Fault:
    return catalogue().read(entry)


def with_errors(cell=CELL, **errors):
    """The cell in which only the named errors are on, as large as given."""
    return replace(cell, simulate=replace(cell.simulate, errors=dict.fromkeys(ERRORS, 0.0) | errors))


def world(seed=1, cell=CELL, **errors):
    """A world in which only the named errors are on."""
    return World(with_errors(cell, **errors), seed)


def cell_with_sphere(bench, beside_deg=0.25):
    """The cell with one sphere on the circle that the tool describes about A1, touched after so many degrees."""
    cell = bench().cell
    x, y, z = bench().world().true_tcp(HOME)
    radius, heading = hypot(x, y), degrees(atan2(y, x))
    chord_deg = 2 * degrees(np.arcsin(TOUCH_MM / (2 * radius)))
    towards = radians(heading - beside_deg - chord_deg)  # A1 turns the other way round the base's z
    sphere = replace(cell.artefact.spheres[0], centre=(radius * cos(towards), radius * sin(towards), z))
    return replace(cell, artefact=replace(cell.artefact, spheres=(sphere,), distances=()))


def search_until_contact(pc):
    """Go along A1 until the loop closes, and leave RSI; the last reply."""
    pc.rsi_on()
    for i in range(300):
        pc.cycles(1, (STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))
        if pc.changes:
            break
    return pc.finish((STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))


class TcpBench(Bench):
    """A simulated device that the subclass starts, and its clients."""

    def __init__(self):
        super().__init__()
        self.clients = []
        self.number = 0

    @property
    def port(self):
        raise NotImplementedError

    def stop(self):
        raise NotImplementedError

    def call(self):
        self.clients.append(socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S))
        return self.clients[-1]

    def close(self):
        self.stop()
        super().close()
        for client in self.clients:
            client.close()
