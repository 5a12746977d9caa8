"""The console's example: a simulated KR5 R1400 with errors of its own, measured by a tracker at a place of its own.

`python tests/helpers/simulated_example.py` writes the file again.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.operations.analyses import EXAMPLE
from sims.cell import read_cell
from sims.world import World

CELL = Path(__file__).parents[2] / "procedures" / "cells" / "tracker_cell.yaml"
SEED, ROWS, NOISE_MM = 5, 100, 0.03
REGION_DEG = ((-60, 60), (-110, -50), (60, 120), (-90, 90), (20, 80), (-120, 120))


def rows() -> Iterator[tuple[list[float], list[float]]]:
    """Joints, degrees, and the TCP in the tracker's frame with its noise, mm."""
    cell = read_cell(CELL)
    world, draw = World(cell, SEED), random.Random(SEED)
    turn = Rotation.from_euler("z", 150.0, degrees=True)
    for _ in range(ROWS):
        joints = [round(draw.uniform(*limits), 3) for limits in REGION_DEG]
        tcp = np.array(world.true_tcp(joints)) + world.scatter(joints, 0) - (3400.0, -1200.0, 900.0)
        yield joints, [place + draw.gauss(0.0, NOISE_MM) for place in turn.inv().apply(tcp).tolist()]


def text() -> str:
    """The data set as CSV."""
    lines = [",".join(f"{value:.3f}" for value in (*joints, *place)) for joints, place in rows()]
    return "\n".join(["A1,A2,A3,A4,A5,A6,X,Y,Z", *lines, ""])


if __name__ == "__main__":
    EXAMPLE.write_text(text())
