"""Contacts of a search: their moment against a closed form, their record against the world's own truth."""

from __future__ import annotations

from math import dist, hypot, radians

import numpy as np
import pytest

from tests.helpers.sims import HOME, STEP_DEG, TOUCH_MM, cell_with_sphere


def search(pc, cycles, step=STEP_DEG, stop_after=None):
    """Go along A1 until so many cycles after the contact was seen; the last reply."""
    pc.rsi_on()
    seen = 0
    for i in range(cycles):
        pc.cycles(1, (step * i, 0.0, 0.0, 0.0, 0.0, 0.0))
        seen += bool(pc.changes)
        if stop_after is not None and seen > stop_after:
            break
    return pc.finish((step * i, 0.0, 0.0, 0.0, 0.0, 0.0))


def test_the_loop_closes_at_the_exact_moment_on_a_circle_at_constant_speed(bench):
    cell = cell_with_sphere(bench, beside_deg=0.2503)
    pc = bench(cell=cell)
    pc.rsi_on()
    first = pc.telegram()
    begin = pc.kernel.now
    pc.answer(first)
    for i in range(1, 80):
        pc.cycles(1, (STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))
    ((moment, closed),) = pc.changes
    assert closed is True
    # the answer to telegram i is the set-point at the end of cycle i + 1: A1 = 1 deg/s · (t − 8 ms)
    assert moment - begin == pytest.approx((0.2503 / 1.0 + 0.008) * 1e9, abs=200)
    assert moment % 4_000_000
    assert pc.finish((STEP_DEG * 79, 0.0, 0.0, 0.0, 0.0, 0.0))[1] == 0


def test_the_truth_log_tells_where_the_tip_touched_and_how_far_it_ran_on(bench):
    cell = cell_with_sphere(bench, beside_deg=0.25)
    pc = bench(cell=cell, errors={"servo": 1})
    assert search(pc, 200, stop_after=1)[1] == 0
    (line,) = pc.truth_lines()
    world = pc.world()
    assert line["search"] == 1
    assert line["sphere"] == "S1"
    assert line["tcp"] == pytest.approx(world.true_tcp(line["joints"]), abs=1e-9)
    assert line["distance"] == pytest.approx(TOUCH_MM, abs=1e-6)
    assert line["centre"] == pytest.approx(world.spheres[0].centre)
    assert line["time_ns"] == pc.changes[0][0] < line["stopped_ns"]
    resting = pc.command("HELLO")[2]
    assert line["overtravel_mm"] == pytest.approx(dist(line["tcp"], world.true_tcp(resting)), abs=2e-3)
    speed_mm_s = radians(1.0) * hypot(line["tcp"][0], line["tcp"][1])
    assert 0.0 < line["overtravel_mm"] < speed_mm_s * (0.024 + 4 * 0.004)


def test_the_scatter_of_the_approach_pose_is_in_the_contact_and_returns_with_the_same_approach(bench):
    cell = cell_with_sphere(bench, beside_deg=0.25)
    lines = []
    for pc in (bench(cell=cell, errors={"repeatability": 1}), bench(cell=cell, errors={"repeatability": 1})):
        pc.ptp((-1.0, *HOME[1:]))
        pc.ptp(HOME)
        assert search(pc, 200, stop_after=1)[1] == 0
        lines.append(pc.truth_lines()[0])
    assert lines[0]["joints"] == pytest.approx(lines[1]["joints"], abs=1e-9)
    assert lines[0]["attempt"] == 1  # the robot stood there when the controller was started
    world = pc.world()
    shift = np.subtract(lines[0]["tcp"], world.true_tcp(lines[0]["joints"]))
    assert shift == pytest.approx(world.scatter(HOME, 1), abs=1e-9)


def test_a_search_without_a_sphere_in_its_way_touches_nothing(bench):
    pc = bench()
    assert search(pc, 100)[1] == 0
    assert pc.changes == []
    assert pc.truth_lines() == []


def test_withdrawing_opens_the_loop_and_the_next_search_touches_again(bench):
    cell = cell_with_sphere(bench, beside_deg=0.25)
    pc = bench(cell=cell, errors={"servo": 1})
    search(pc, 200, stop_after=1)
    assert pc.ptp(HOME)[1] == 0
    assert [closed for _, closed in pc.changes] == [True, False]
    pc.rsi_on(9)
    pc.cycles(80, lambda i: (STEP_DEG * i, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert pc.finish((STEP_DEG * 79, 0.0, 0.0, 0.0, 0.0, 0.0))[1] == 0
    assert [(line["search"], line["attempt"]) for line in pc.truth_lines()] == [(1, 0), (2, 1)]


def test_a_search_comes_out_the_same_whatever_moment_it_begins(bench):
    cell = cell_with_sphere(bench, beside_deg=0.25)
    contacts = []
    for waits in (0, 3):
        pc = bench(cell=cell, errors={"servo": 1, "encoder": 1})
        for _ in range(waits):
            pc.document("Stat")
        pc.rsi_on()
        begin = pc.telegram()
        started = pc.kernel.now
        pc.answer(begin)
        pc.cycles(80, lambda i: (STEP_DEG * (i + 1), 0.0, 0.0, 0.0, 0.0, 0.0))
        contacts.append(pc.changes[0][0] - started)
        pc.finish((STEP_DEG * 80, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert contacts[0] == contacts[1]
