"""A tip that wears with its touches, or is suddenly shorter, as the contacts of searches show it."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, degrees, dist, hypot, radians, sin

import numpy as np
import pytest

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
STEP_DEG = 0.004
TOUCH_MM = 61.4 / 2 + 0.6


def cell_with_sphere(bench, beside_deg=0.25):
    """The cell with one sphere on the circle that the tool describes about A1, touched after so many degrees."""
    cell = bench().cell
    x, y, z = bench().world().true_tcp(HOME)
    radius, heading = hypot(x, y), degrees(atan2(y, x))
    towards = radians(heading - beside_deg - 2 * degrees(np.arcsin(TOUCH_MM / (2 * radius))))
    sphere = replace(cell.artefact.spheres[0], centre=(radius * cos(towards), radius * sin(towards), z))
    return replace(cell, artefact=replace(cell.artefact, spheres=(sphere,), distances=()))


def touch(pc):
    """Search until the contact, and back."""
    pc.changes.clear()
    pc.rsi_on()
    for i in range(300):
        pc.cycles(1, (STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))
        if pc.changes:
            break
    assert pc.finish((STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))[1] == 0
    assert pc.ptp(HOME)[1] == 0


def check_contact(pc, line):
    """The contact is where the tip, as worn as the line says, meets the sphere."""
    worn = pc.world()
    worn.ageing.shorten(line["worn_mm"])
    assert line["tcp"] == pytest.approx(worn.true_tcp(line["joints"]), abs=1e-9)
    assert dist(line["tcp"], worn.spheres[0].centre) == pytest.approx(TOUCH_MM, abs=1e-6)


def test_each_touch_is_made_with_what_the_ones_before_have_left_of_the_tip(bench):
    pc = bench(cell=cell_with_sphere(bench), errors={"wear": 20})
    for _ in range(3):
        touch(pc)
    lines = pc.truth_lines()
    assert [line["worn_mm"] for line in lines] == pytest.approx([0.0, 0.01, 0.02])
    for line in lines:
        check_contact(pc, line)
    assert lines[0]["joints"] != lines[1]["joints"] != lines[2]["joints"]


def test_after_a_jump_the_tip_is_shorter_for_good(bench):
    pc = bench(cell=cell_with_sphere(bench))
    touch(pc)
    pc.fault(fault="tip.jump", mm=0.3)
    touch(pc)
    touch(pc)
    lines = pc.truth_lines()
    assert [line["worn_mm"] for line in lines] == [0.0, 0.3, 0.3]
    for line in lines:
        check_contact(pc, line)
    assert lines[1]["joints"] == pytest.approx(lines[2]["joints"], abs=1e-6)


def test_a_jump_in_mid_search_moves_the_contact_of_that_search(bench):
    cell = cell_with_sphere(bench)
    pc = bench(cell=cell, faults=[{"fault": "tip.jump", "search": 1, "after_ms": 100, "mm": 0.3}])
    touch(pc)
    (line,) = pc.truth_lines()
    assert line["worn_mm"] == 0.3
    check_contact(pc, line)


def test_a_tip_that_breaks_off_in_contact_opens_the_loop(bench):
    cell = cell_with_sphere(bench)
    pc = bench(cell=cell)
    pc.rsi_on()
    for i in range(100):
        pc.cycles(1, (STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))
        if pc.changes:
            break
    assert pc.finish((STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))[1] == 0
    assert pc.loop.closed
    pc.fault(fault="tip.jump", mm=200.0)
    assert not pc.loop.closed


def test_a_wear_of_nothing_leaves_every_contact_the_same(bench):
    pc = bench(cell=cell_with_sphere(bench))
    touch(pc)
    touch(pc)
    first, second = pc.truth_lines()
    assert first["worn_mm"] == second["worn_mm"] == 0.0
    assert first["joints"] == pytest.approx(second["joints"], abs=1e-6)
