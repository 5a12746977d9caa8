"""A tip that wears with its touches, or is suddenly shorter, as the contacts of searches show it."""

from __future__ import annotations

from math import dist

import pytest

from tests.helpers.sims import HOME, TOUCH_MM, cell_with_sphere, search_until_contact


def touch(pc):
    """Search until the contact, and back."""
    pc.changes.clear()
    assert search_until_contact(pc)[1] == 0
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
    assert search_until_contact(pc)[1] == 0
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
