"""What rows cannot see is counted right and said in words, for 6 and 7 joints, tables and axes, and for effects."""

import numpy as np
import pytest
from own_campaigns import place

from cellctl.calibration import (
    Backlash,
    Growth,
    JointCompliance,
    PoseRows,
    PositionRows,
    Postures,
    RobotModel,
    Split,
    Task,
    TouchRows,
    fit,
)
from cellctl.kinematics import Link, SerialChain, pose_from_xyz_abc, to_poe

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
        rows = TouchRows(q, point, reach + rng.normal(0.0, 0.03, len(q)), np.full((len(q), 1), 0.03))
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
    return JointCompliance.of(robot, load_known=True), Backlash(7), Growth.of(robot)


def test_effects_of_conditions_that_nobody_noted_are_named_one_by_one(robot):
    words = " ".join(seen(robot, angles(), "positions", effects_of(robot)).unseen)
    for joint in range(1, 8):
        assert f"backlash of joint {joint}" in words
        assert joint == 1 or f"compliance under load of joint {joint}" in words
    for link in (1, 3, 5, 7):
        assert f"growth of link {link}" in words


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
