"""What rows cannot see is counted right and said in words, for 6 and 7 joints, tables and axes, and for effects."""

import numpy as np
import pytest

from cellctl.calibration import (
    Backlash,
    Hidden,
    JointCompliance,
    PoseRows,
    PositionRows,
    Postures,
    RobotModel,
    Split,
    State,
    Task,
    ThermalExpansion,
    Tolerances,
    TouchRows,
    Unknowns,
    fit,
)
from cellctl.calibration.observability.unobservable import in_words
from cellctl.kinematics import Link, SerialChain, pose_from_xyz_abc, to_poe
from tests.helpers.own_campaigns import place

IIWA = [(360, -90), (0, 90), (420, 90), (0, -90), (400, -90), (0, 90), (126, 0)]
TOOL = pose_from_xyz_abc([30, 20, 100], [10, 20, 30])
TABLE = SerialChain.from_links("mdh-hayati", [Link(0.0, d, 0.0, np.radians(a)) for d, a in IIWA], None, TOOL)
ROBOTS = {"table": TABLE, "axes": to_poe(TABLE)}
ANCHORS = np.array([[900.0, 0.0, 300.0], [0.0, 900.0, 300.0], [-500.0, -700.0, 400.0]])
ROWS = 80


@pytest.fixture(params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]


def angles(still=(), rows=ROWS):
    q = np.random.default_rng(1).uniform(-1.5, 1.5, (rows, 7))
    q[:, list(still)] = 0.3
    return q


def seen(robot, q, kind, effects=(), at=None):
    """What a fit of the rows sees. kind: positions, poses, or distances from three anchors."""
    rng = np.random.default_rng(2)
    true = robot.with_base(place(rng)).forward(q)
    xyz = true[:, :3, 3] + rng.normal(0.0, 0.03, (len(q), 3))
    model, points, rough = RobotModel(robot, effects), (), None
    if kind == "positions":
        rows = PositionRows(at or q, xyz, np.full((len(q), 3), 0.03))
    elif kind == "poses":
        rows = PoseRows(at or q, true, np.hstack([np.full((len(q), 3), 0.03), np.full((len(q), 3), 1e-4)]))
    else:
        points, rough = (
            ("W1", "W2", "W3"),
            np.array([[900.0, 0.0, 300.0], [0.0, 900.0, 300.0], [-500.0, -700.0, 400.0]]),
        )
        point = np.arange(len(q)) % 3
        reach = np.linalg.norm(robot.forward(q)[:, :3, 3] - rough[point], axis=1)
        rows = TouchRows(at or q, point, reach + rng.normal(0.0, 0.03, len(q)), np.full((len(q), 1), 0.03))
    return fit(Task(model, rows, points, rough), Split(np.arange(len(q)), ())).observability


@pytest.mark.parametrize(
    ("kind", "rank"),
    [
        ("positions", 4 * 7 + 3),  # four numbers for each axis that moves, three of the tool centre point
        ("poses", 4 * 7 + 6),
        ("distances", 4 * 7 + 3 - 6 + 9),  # three anchors, and no frame to see them from
    ],
)
def test_as_many_combinations_are_seen_as_geometry_allows(robot, kind, rank):
    assert seen(robot, angles(), kind).rank == rank


@pytest.mark.parametrize("still", [(2,), (0,), (6,), (1, 4)])
def test_a_joint_that_never_moves_shows_four_numbers_less(robot, still):
    assert seen(robot, angles(still), "positions").rank == 4 * (7 - len(still)) + 3


def test_a_tables_heading_and_height_are_told_with_what_takes_them_up():
    assert {"θ1 with base rotation about Z", "d1 with base translation along Z"} <= set(
        seen(TABLE, angles(), "positions").unseen
    )
    assert {"θ1 with centres of W1, W2, W3", "d1 with centres of W1, W2, W3"} <= set(
        seen(TABLE, angles(), "distances").unseen
    )


def test_of_axes_the_frame_of_the_first_is_told_with_the_base():
    unseen = seen(ROBOTS["axes"], angles(), "positions").unseen
    assert len(unseen) == 6
    assert all("axis 1 " in phrase or "axis 2 " in phrase for phrase in unseen)
    assert all("base" in phrase for phrase in unseen)


def test_a_tools_rotation_is_told_with_the_last_joint_where_poses_are_measured():
    unseen = seen(TABLE, angles(), "poses").unseen
    assert any(phrase.startswith("θ7 with tool rotation") for phrase in unseen)
    assert not any("tool rotation" in phrase for phrase in seen(TABLE, angles(), "positions").unseen)


def effects_of(robot):
    return JointCompliance.of(robot, load_known=True), Backlash(7), ThermalExpansion.of(robot)


def test_effects_of_conditions_that_nobody_noted_are_named_joint_by_joint_in_one_phrase(robot):
    words = " ".join(seen(robot, angles(), "positions", effects_of(robot)).unseen)
    assert "backlash of joints 1, 2, 3, 4, 5, 6, 7" in words
    assert "compliance under load of joints 2, 3, 4, 5, 6, 7" in words
    assert "growth of links 1, 3, 5, 7" in words


def test_a_condition_that_never_changes_is_told_with_what_looks_the_same(robot):
    q = angles()
    at = Postures(q, np.ones_like(q), np.full(ROWS, 5.0), np.full(ROWS, 3.0))
    unseen = seen(robot, q, "positions", effects_of(robot), at).unseen
    assert "base rotation about Z with backlash of joint 1" in unseen
    assert "base translation along Z with growth of link 1" in unseen
    for joint in range(2, 8):
        assert f"compliance of joint {joint} with compliance under load of joint {joint}" in unseen


def test_conditions_that_change_show_the_effects(robot):
    rng, q = np.random.default_rng(3), angles(rows=2 * ROWS)
    at = Postures(q, rng.choice([-1.0, 1.0], q.shape), rng.uniform(-5, 15, len(q)), rng.uniform(0, 6, len(q)))
    found = seen(robot, q, "positions", effects_of(robot), at)
    assert not any("backlash" in phrase or "growth" in phrase or "load" in phrase for phrase in found.unseen)


def by_cause(found):
    """Of each cause, how many combinations it hides; those that harm nothing under `harmless`."""
    return {"harmless" if each.harmless else each.reason: len(each.combinations) for each in found.hidden}


@pytest.mark.parametrize("kind", ["positions", "poses", "distances"])
def test_a_joint_that_never_moves_is_named_as_the_cause_of_the_four_numbers_that_it_hides(robot, kind):
    found = seen(robot, angles((2,)), kind)
    assert by_cause(found) == {"joint 3 never moves in these rows": 4, "harmless": 6}
    assert by_cause(seen(robot, angles(), kind)) == {"harmless": 6}


def test_several_joints_that_never_move_are_one_cause(robot):
    assert by_cause(seen(robot, angles((1, 4)), "positions"))["joints 2, 5 never move in these rows"] == 8


def test_rows_at_one_posture_are_told_so_before_anything_else():
    first, *_ = seen(TABLE, angles(range(7)), "positions").hidden
    assert first.reason == "all rows are at one posture"


def test_a_joint_that_hardly_moves_is_named_with_how_much():
    q = angles()
    q[:, 2] = np.linspace(0.0, np.radians(0.4), len(q))
    assert by_cause(seen(TABLE, q, "positions"))["joint 3 moves by 0.4° only"] == 2
    assert set(by_cause(seen(TABLE, angles(), "positions"))) == {"harmless"}


def test_conditions_that_nobody_noted_are_the_causes_of_what_they_hide(robot):
    assert by_cause(seen(robot, angles(), "positions", effects_of(robot))) == {
        "no row says from which side its joints came": 7,
        "no row says its payload": 6,
        "no row says its temperature": 4,
        "harmless": 6,
    }


def test_conditions_that_never_change_are_the_causes_of_what_they_hide():
    q = angles()
    at = Postures(q, np.ones_like(q), np.full(ROWS, 5.0), np.full(ROWS, 3.0))
    found = by_cause(seen(TABLE, q, "positions", effects_of(TABLE), at))
    assert found["every row was approached from the same side"] == 7
    assert found["the payload never changes in these rows"] >= 4  # the wrist carries too little to tell it
    assert found["the temperature never changes in these rows"] == 4
    sides = np.where(np.arange(ROWS)[:, None] % 2, 1.0, -1.0) * np.ones(7)
    sides[:, 3] = 1.0
    one_sided = seen(TABLE, q, "positions", (Backlash(7),), Postures(q, sides))
    assert by_cause(one_sided)["joint 4 always came from the same side"] == 1


def test_what_takes_up_the_base_and_the_tool_is_said_to_harm_nothing_and_last():
    *_, last = seen(TABLE, angles((2,)), "positions").hidden
    assert last.harmless
    assert "θ1 with base rotation about Z" in last.phrases()
    assert "θ7, d7, α7 each with tool translation along X, Y, Z" in last.phrases()


def test_alike_parameters_are_told_in_one_phrase():
    at = Postures(angles(), np.ones((ROWS, 7)), np.full(ROWS, 5.0), np.full(ROWS, 3.0))
    found = seen(TABLE, angles(), "positions", effects_of(TABLE), at)
    (sides,) = [each for each in found.hidden if each.reason.startswith("every row")]
    assert "θi with backlash of joint i, i = 2, 3, 4, 5, 6" in sides.phrases()
    (alone,) = [each for each in seen(TABLE, angles(), "positions", (Backlash(7),)).hidden if not each.harmless]
    assert alone.phrases() == ["backlash of joints 1, 2, 3, 4, 5, 6, 7: each alone"]


def test_of_a_combination_of_many_a_screen_has_the_first_and_the_rest_in_number():
    many = [f"{letter}{number}" for number in range(1, 8) for letter in ("d", "a")]
    known = {parameter.name: parameter for parameter in RobotModel(TABLE).parameters}
    hidden = Hidden("joint 3 never moves in these rows", (tuple(known[name] for name in many),))
    assert hidden.phrases(5) == ["d1 with a1, d2, a2, d3 and 9 others"]
    assert hidden.summary()["combinations"] == [many]
    assert hidden.summary()["words"] == [f"d1 with {', '.join(many[1:])}"]


def test_a_point_may_be_called_as_the_robots_own_tool():
    state = State.alone(RobotModel(TABLE), np.zeros((2, 3)))
    unknowns = Unknowns.of(state, ("tool", "S1"), Tolerances())
    assert len(set(unknowns.names)) == len(unknowns.names)
    assert in_words(unknowns.parameters[-6:]) == ["centres of point tool, S1"]
