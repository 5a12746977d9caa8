"""A robot whose joints have play: its links lag behind the way that each joint moved last, and remember it."""

from __future__ import annotations

import json
from math import dist

import pytest

from sims.conditions import Conditions
from sims.memory import Memory
from tests.helpers.sims import HOME, TOUCH_MM, cell_with_sphere, search_until_contact


@pytest.fixture
def again(bench, tmp_path):
    """Starts a controller with the memory of the one before, which is gone."""

    def begin(**how):
        return bench(memory=Memory(tmp_path / "state.json"), errors={"backlash": 3, "compliance": 1, "gear": 1}, **how)

    return begin


def come_from(pc, directions):
    """To HOME, every joint in its own direction, by more than any play."""
    assert pc.ptp(tuple(joint - 0.1 * way for joint, way in zip(HOME, directions, strict=True)), number=1)[1] == 0
    assert pc.ptp(HOME, number=2)[1] == 0


def contact(pc):
    """Search along A1 until it touches, and stop; the truth about it."""
    search_until_contact(pc)
    return pc.truth_lines()[-1]


@pytest.mark.parametrize("others", [(1, 1, 1, 1, 1), (-1, -1, -1, -1, -1), (1, -1, 1, 1, -1)])
def test_the_tip_touches_where_the_last_way_of_every_joint_leaves_its_link(bench, again, others):
    pc = again(cell=cell_with_sphere(bench))
    come_from(pc, (-1, *others))
    line = contact(pc)
    world, state = pc.world(), Conditions((1, *others))
    assert line["tcp"] == pytest.approx(world.true_tcp(line["joints"], state), abs=1e-6)
    assert line["distance"] == pytest.approx(TOUCH_MM, abs=1e-4)
    assert dist(line["tcp"], world.true_tcp(line["joints"])) > 0.05


def test_the_same_way_ends_in_the_same_place_however_often_it_is_gone(bench, again):
    pc = again(cell=cell_with_sphere(bench))
    joints = []
    for before in ((1, 1, 1, 1, 1, 1), (-1, 1, -1, 1, -1, 1)):
        come_from(pc, before)
        come_from(pc, (-1, 1, 1, -1, 1, 1))
        pc.changes.clear()
        joints.append(contact(pc)["joints"])
    assert joints[0] == pytest.approx(joints[1], abs=1e-6)


def test_a_robot_that_is_started_again_lags_as_it_did(bench, again, tmp_path):
    cell = cell_with_sphere(bench)
    come_from(again(cell=cell), (-1, -1, 1, -1, 1, -1))
    lag = again(cell=cell).world().backlash.behind((-1, -1, 1, -1, 1, -1))
    assert json.loads((tmp_path / "state.json").read_text())["robot"]["slack"] == pytest.approx(lag, abs=1e-9)
    line = contact(pc := again(cell=cell))
    expected = pc.world().true_tcp(line["joints"], Conditions((1, -1, 1, -1, 1, -1)))
    assert line["tcp"] == pytest.approx(expected, abs=1e-6)


def test_a_memory_from_before_there_was_play_is_still_one(bench, tmp_path):
    stands = {"joints": HOME, "commanded": HOME, "scatter": [0, 0, 0], "attempt": 0, "attempts": {}}
    (tmp_path / "state.json").write_text(json.dumps({"cell": {}, "robot": stands}))
    pc = bench(memory=Memory(tmp_path / "state.json"), errors={"backlash": 1})
    assert pc.command("HELLO")[2] == pytest.approx(HOME)
