"""A controller's own program, corrected on-line in motion: the World's truth judges the path at three speeds."""

from __future__ import annotations

import pytest

from sims.cell import read_cell
from tests.helpers.simulated_robots import HEAVY_CELL, TcpPath, identified, lag_of, travel

HEAVY = read_cell(HEAVY_CELL)
SPEEDS_MM_S = (100.0, 200.0, 300.0)
SERVO_AND_CYCLE_MS = (24.0, 40.0)
"""Servo 24 ms, one cycle to the answer, one for the step: 32 ms at 4 ms."""


@pytest.fixture(scope="module")
def model():
    return identified()


@pytest.mark.long
@pytest.mark.parametrize("shape", ["circle", "U"])
def test_the_correction_brings_the_path_of_a_program_near_the_nominal_one_at_every_speed(bench, model, shape):
    pc = bench(errors=HEAVY.simulate.errors, cell=HEAVY)
    print(f"\n{shape}: speed mm/s; before mean, max; after mean, max (mm); delay ms, by it mm")
    for speed in SPEEDS_MM_S:
        path = TcpPath.of(shape, speed, model)
        before = travel(pc, path, model, corrected=False).deviation(path)
        way = travel(pc, path, model, corrected=True)
        after, lag = way.deviation(path), lag_of(way, model)
        figures = (before.mean(), before.max(), after.mean(), after.max(), lag.ms, lag.mm)
        print(f"{speed:6g} " + " ".join(f"{each:8.3f}" for each in figures))
        assert before.mean() > 0.5
        assert after.max() <= 0.15
        assert SERVO_AND_CYCLE_MS[0] <= lag.ms <= SERVO_AND_CYCLE_MS[1]
        assert lag.mm <= 0.1
