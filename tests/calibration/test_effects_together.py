"""All effects at once on robots of 1, 2, 6 and 7 joints in every convention: each derivative against differences."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.calibration import (
    DOWN,
    Backlash,
    Harmonics,
    JointCompliance,
    PoseRows,
    PositionRows,
    Postures,
    RobotModel,
    SocketRows,
    SpacingRows,
    State,
    ThermalExpansion,
    Tolerances,
    ToolDeflection,
    TouchRows,
    Unknowns,
)
from cellctl.kinematics import JointAxis, Link, SerialChain, pose_from_xyz_abc

ROWS = 6
ROBOTS = [(convention, joints) for convention in ("mdh-hayati", "dh-craig", "poe") for joints in (1, 2, 6, 7)]
CASES = [(convention, joints, kind) for convention, joints in ROBOTS for kind in ("poses", "touches")]
CASES += [("mdh-hayati", joints, kind) for joints in (2, 7) for kind in ("positions", "sockets")]
CASES += [("poe", 2, "spacings")]


def chain_of(rng, convention, joints):
    """A robot of nobody's making; the second axis of a table is along the first (with beta)."""
    base, tool = (pose_from_xyz_abc(rng.uniform(-300, 300, 3), rng.uniform(-170, 170, 3)) for _ in range(2))
    if convention == "poe":
        axes = [JointAxis.through(rng.uniform(-500, 500, 3), rng.normal(size=3)) for _ in range(joints)]
        return SerialChain.from_axes(axes, pose_from_xyz_abc([400, 30, 700], [20, 50, -70]), base, tool)
    links = [Link(*rng.uniform(-1, 1, 4) * [2.0, 300.0, 400.0, 1.5]) for _ in range(joints)]
    if joints > 1:
        links[1] = Link(0.3, 0.0, 420.0, 0.0, 0.0)
    return SerialChain.from_links(convention, links, base, tool)


def effects_of(chain, down=DOWN):
    """All five effects, with a ripple of twelve waves per turn of joint 1."""
    bend, compliance = ToolDeflection(0.4, 15.0, down=down), JointCompliance.of(chain, load_known=True, down=down)
    harmonics = Harmonics(chain.n, orders=(1, 2), ripple=((1, 12),))
    return (bend, compliance, harmonics, Backlash(chain.n), ThermalExpansion.of(chain))


def unknowns_of(rng, chain, own, down=DOWN):
    """Everything unknown of a bad robot in two sessions, effects ten times what is expected; where it is asked (P,)."""
    model = RobotModel(chain, effects_of(chain, down))
    sizes = np.where(model.parameter_turns, 0.02, 3.0)
    amounts = np.concatenate([effect.sigma for effect in model.effects])
    sizes[len(sizes) - len(amounts) :] = 10.0 * amounts
    first = model.with_deviations(sizes * rng.standard_normal(len(sizes)))
    placed = pose_from_xyz_abc([2000.0, -400.0, 90.0], [100, 8, -5]), pose_from_xyz_abc([40, 60, 80], [9, -70, 30])
    second = first.on(
        placed[0] if "base" in own else first.chain.base, placed[1] if "tool" in own else first.chain.tool
    )
    state = State.of_sessions([first, second], [own], rng.uniform(-900, 900, (3, 3)))
    unknowns = Unknowns.of(state, ("P", "Q", "R"), Tolerances(flat_mm=1.0), sessions=("later",))
    return unknowns, unknowns.sigma * rng.standard_normal(len(unknowns.names))


def rows_of(kind, rng, unknowns, at):
    """Rows of a kind in the second session, far from where the robot is (poses: turned by up to 170°)."""
    robot = unknowns.state(at).models[1]
    q = rng.uniform(-2.5, 2.5, (ROWS, robot.n))
    postures = Postures(q, rng.choice([-1.0, 0.0, 1.0], q.shape), rng.uniform(-10, 15, ROWS), rng.uniform(0, 6, ROWS))
    point, poses = np.array([0, 1, 2, 0, 1, 2]), robot.pose(postures)
    away = rng.normal(size=(ROWS, 3))
    away *= np.radians(rng.uniform(0, 170, (ROWS, 1))) / np.linalg.norm(away, axis=1, keepdims=True)
    poses[:, :3, :3] = Rotation.from_rotvec(away).as_matrix() @ poses[:, :3, :3]
    poses[:, :3, 3] += rng.normal(0.0, 50.0, (ROWS, 3))
    match kind:
        case "positions":
            return PositionRows(postures, poses[:, :3, 3], np.ones((ROWS, 3)), 1)
        case "poses":
            return PoseRows(postures, poses, np.ones((ROWS, 6)), 1)
        case "touches":
            return TouchRows(postures, point, np.full(ROWS, 31.3), np.ones((ROWS, 1)), 1)
        case "sockets":
            return SocketRows(postures, point, np.ones((ROWS, 3)), 1)
        case _:
            return SpacingRows(np.array([[0, 1], [2, 1]]), np.array([600.0, 400.0]), np.ones((2, 1)))


def assert_columns_are_differences(rows, unknowns, at):
    columns = rows.jacobian(unknowns.state(at))
    assert columns.shape == (*rows.residual(unknowns.state(at)).shape, len(unknowns.names))
    for index, name in enumerate(unknowns.names):
        step = np.zeros(len(at))
        step[index] = 0.01 * unknowns.sigma[index]  # 10 µm, 10 µrad: third order and rounding are small
        ahead, behind = (rows.residual(unknowns.state(at + side * step)) for side in (1.0, -1.0))
        numeric = (ahead - behind) / (2.0 * step[index])
        close = 1e-6 * np.abs(numeric).max() + 1e-11 / step[index]
        np.testing.assert_allclose(columns[..., index], numeric, rtol=0, atol=close, err_msg=name)


@pytest.mark.parametrize(("convention", "joints", "kind"), CASES)
def test_every_kind_of_row_moves_with_every_unknown_as_its_jacobian_says(convention, joints, kind):
    rng = np.random.default_rng(joints)
    unknowns, at = unknowns_of(rng, chain_of(rng, convention, joints), frozenset({"base", "tool"}))
    turning = (
        frozenset() if joints == 1 and convention != "poe" else {"compliance"}
    )  # an upright joint carries no weight
    assert {"deflection", "harmonics", "backlash", "growth", *turning} < set(unknowns.groups)
    assert_columns_are_differences(rows_of(kind, rng, unknowns, at), unknowns, at)


@pytest.mark.parametrize(("convention", "joints"), [("mdh-hayati", 1), ("dh-craig", 6), ("poe", 2)])
@pytest.mark.parametrize("kind", ["poses", "touches"])
def test_so_it_does_where_the_robot_hangs_on_a_wall_or_stands_on_a_slope(convention, joints, kind):
    rng = np.random.default_rng(joints)
    down = tuple((lambda v: v / np.linalg.norm(v))(rng.normal(size=3)).tolist())
    unknowns, at = unknowns_of(rng, chain_of(rng, convention, joints), frozenset({"base", "tool"}), down)
    assert {"compliance1_1x", f"compliance_load{joints}"} < set(unknowns.names)
    assert_columns_are_differences(rows_of(kind, rng, unknowns, at), unknowns, at)


@pytest.mark.parametrize("own", [frozenset(), frozenset({"base"}), frozenset({"tool"})], ids=["none", "base", "tool"])
@pytest.mark.parametrize("kind", ["poses", "sockets"])
def test_a_session_moves_with_what_it_shares_and_with_its_own_base_or_tool_and_no_other(kind, own):
    rng = np.random.default_rng(3)
    unknowns, at = unknowns_of(rng, chain_of(rng, "mdh-hayati", 2), own)
    rows = rows_of(kind, rng, unknowns, at)
    assert_columns_are_differences(rows, unknowns, at)
    columns = dict(zip(unknowns.names, np.moveaxis(rows.jacobian(unknowns.state(at)), -1, 0), strict=True))
    for part in ("base", "tool"):
        moved = {name for name in columns if name.startswith(f"{part}_x") and columns[name].any()}
        assert moved == {f"{part}_x@later" if part in own else f"{part}_x"}


@pytest.mark.parametrize(("convention", "joints"), ROBOTS)
def test_effects_turn_with_the_robot_wherever_its_base_stands(convention, joints):
    """Gravity, growth and play are the robot's own: a robot moved as a whole takes its errors with it."""
    rng = np.random.default_rng(joints)
    chain = chain_of(rng, convention, joints)
    at = Postures(rng.uniform(-2, 2, (ROWS, joints)), np.ones((ROWS, joints)), np.full(ROWS, 9.0), np.full(ROWS, 4.0))
    effects = effects_of(chain)
    amounts = np.concatenate([effect.sigma * rng.standard_normal(len(effect.sigma)) for effect in effects])
    upright = RobotModel(chain.with_base(np.eye(4)), effects, amounts)
    placed = RobotModel(chain, effects, amounts)
    np.testing.assert_allclose(placed.pose(at), chain.base @ upright.pose(at), rtol=0, atol=1e-8)
