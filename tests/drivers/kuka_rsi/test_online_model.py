"""The correction of the cyclic process agrees with the compensation of targets, for every part of a model."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.calibration import (
    Backlash,
    Discrepancy,
    Effect,
    Harmonics,
    JointCompliance,
    JointField,
    Postures,
    RobotModel,
    ThermalExpansion,
    ToolDeflection,
)
from cellctl.compensation import compensate
from cellctl.compensation.online import online_arrays
from cellctl.formats import RobotFile
from cellctl.kinematics import inverse_pose
from drivers.kuka_rsi.cyclic.online_block import pack, unpack
from drivers.kuka_rsi.cyclic.online_kernel import newton_step
from drivers.kuka_rsi.cyclic.online_model import OnlineModel
from tests.helpers.krc import wavy_model
from tests.helpers.runs import ROOT

ROBOT = RobotFile.load(ROOT / "procedures" / "papers" / "robots" / "kr300_with_end_effector.yaml")
JOINTS = ROBOT.joint_map()
LOWER, UPPER = np.array([-60, -110, 60, -60, 30, -60.0]), np.array([60, -40, 130, 60, 100, 60.0])
AGREE_MM = 1e-3
MOVING_MM = 5e-3
"""At some 100 deg/s in each axis: by what the correction changes in a cycle, times its own size in rad."""

STEPS_FROM_ZERO = 3


class Invented(Effect):
    """An effect of another package."""

    group = "invented"
    parameters = ()
    sigma = np.zeros(0)

    @classmethod
    def of_inputs(cls, setup):
        return cls()


def chain():
    return ROBOT.chain()


def drawn(count: int, seed: int = 1) -> np.ndarray:
    """Readings within the measured region, deg."""
    return np.random.default_rng(seed).uniform(LOWER, UPPER, (count, 6))


def centres() -> np.ndarray:
    return JOINTS.model(drawn(20, 7))


EFFECTS = {
    "geometry": (),
    "compliance": (JointCompliance.of(chain(), load_known=True),),
    "bending": (ToolDeflection(0.3, 1200.0, 1e-5),),
    "harmonics": (Harmonics(6),),
    "expansion": (ThermalExpansion.of(chain()),),
    "field": (JointField(centres(), np.random.default_rng(2).uniform(1.0, 3.0, (3, 6)), (0.3, 0.2, 0.4)),),
    "discrepancy": (Discrepancy(centres(), 1.5, 0.3),),
}
EFFECTS["all"] = tuple(effect for effects in EFFECTS.values() for effect in effects)
LOADED = Postures(
    np.zeros((1, 6)), delta_t=np.array([3.0]), payload=np.array([8.0]), payload_at=np.array([[-50.0, 0, 200]])
)


def robot_with(effects: tuple, seed: int = 3) -> RobotModel:
    """A robot with errors of the expected sizes."""
    draw = np.random.default_rng(seed)
    nominal = RobotModel(chain(), effects)
    of_chain = np.where(nominal.chain.parameter_turns, 5e-4, 0.4) * draw.normal(size=len(nominal.chain.parameters))
    amounts = [draw.normal(size=len(each.parameters)) * each.sigma for each in effects]
    return nominal.with_deviations(np.concatenate([of_chain, *amounts]))


def corrected(model: OnlineModel, readings: np.ndarray, steps: int = STEPS_FROM_ZERO) -> np.ndarray:
    for _ in range(steps):
        found = model.correction(readings.tolist())
    return readings + found


def posed(robot: RobotModel, readings: np.ndarray) -> np.ndarray:
    at = Postures(JOINTS.model(readings[None]), None, LOADED.delta_t, LOADED.payload, LOADED.payload_at)
    return robot.pose(at)[0]


@pytest.mark.parametrize("part", EFFECTS)
def test_every_part_of_a_model_brings_the_identified_robot_to_the_nominal_pose(part):
    robot = robot_with(EFFECTS[part])
    values = pack(online_arrays(robot, JOINTS, LOWER, UPPER, 2.0, LOADED).arrays)
    before, after = [], []
    for readings in drawn(30):
        goal = chain().forward(JOINTS.model(readings))
        left = inverse_pose(goal) @ posed(robot, corrected(OnlineModel(values), readings))
        before.append(np.linalg.norm(posed(robot, readings)[:3, 3] - goal[:3, 3]))
        after.append(np.linalg.norm(left[:3, 3]))
        assert np.linalg.norm(left[:3, :3] - np.eye(3)) < 2e-6
    assert max(before) > 0.5
    assert max(after) <= AGREE_MM


def test_the_corrections_are_those_of_the_compensation_of_targets():
    robot, readings = robot_with(EFFECTS["harmonics"]), drawn(20)
    q = JOINTS.model(readings)
    found = compensate(chain(), robot, chain().forward(q), q)
    assert found.converged.all()
    model = pack(online_arrays(robot, JOINTS, LOWER, UPPER, 2.0).arrays)
    wanted = JOINTS.readings(found.compensated_q)
    for row, target in zip(readings, wanted, strict=True):
        assert corrected(OnlineModel(model), row) == pytest.approx(target, abs=2e-5)


def test_one_step_a_cycle_keeps_up_with_a_moving_program():
    robot = robot_with(EFFECTS["all"])
    model = OnlineModel(pack(online_arrays(robot, JOINTS, LOWER, UPPER, 2.0, LOADED).arrays))
    start, end = drawn(2)
    errors = []
    for cycle in range(200):
        readings = start + (end - start) * cycle / 200
        found = posed(robot, corrected(model, readings, steps=1))
        errors.append(np.linalg.norm(found[:3, 3] - chain().forward(JOINTS.model(readings))[:3, 3]))
    assert max(errors[3:]) <= MOVING_MM


def test_the_correction_fades_to_nothing_outside_the_measured_region():
    model = OnlineModel(pack(online_arrays(robot_with(()), JOINTS, LOWER, UPPER, 2.0).arrays))
    middle = (LOWER + UPPER) / 2
    shares = [
        model.inside([middle[0], *middle[1:-1], UPPER[-1] + beyond]) for beyond in (-1.0, 0.0, 0.5, 1.0, 2.0, 9.0)
    ]
    assert shares[:2] == [1.0, 1.0]
    assert 1.0 > shares[2] > shares[3] == pytest.approx(0.5)
    assert shares[4:] == [0.0, 0.0]


def test_play_is_named_as_left_out_and_an_unknown_effect_refused():
    found = online_arrays(robot_with((Backlash(6),)), JOINTS, LOWER, UPPER, 2.0)
    assert "backlash" in found.left_out[0]

    with pytest.raises(ValueError, match="invented cannot be computed on-line"):
        online_arrays(robot_with((Invented(),)), JOINTS, LOWER, UPPER, 2.0)


@pytest.mark.parametrize("wrong", [{"fade": (1.0, 2.0)}, {"bend": (float("nan"),)}, {"tool": ()}, {"more": (1.0,)}])
def test_arrays_that_are_no_model_are_refused(wrong):
    arrays = dict(online_arrays(robot_with(()), JOINTS, LOWER, UPPER, 2.0).arrays)
    with pytest.raises(ValueError, match="correction model"):
        pack(arrays | wrong)


TURNED_WRONG = [-1.0, *wavy_model(1.0)["tool"][1:]]
FAR = [*wavy_model(1.0)["tool"][:3], 2e5, *wavy_model(1.0)["tool"][4:]]


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("sign", [0.0] * 6),
        ("sign", [2.0] * 6),
        ("base", [0.0] * 16),
        ("links", [0.0] * 112),
        ("links", [1e9] * 112),
        ("tool", TURNED_WRONG),
        ("tool", FAR),
        ("identified", [1.0] * 112),
        ("identified_base", [0.0] * 9),
        ("wave_joint", [0.0, 1.0, 6.0]),
        ("wave_joint", [0.0, 1.0, -1.0]),
        ("wave_joint", [0.0, 1.0, 0.5]),
        ("wave_order", [1.0, 2.0, 0.0]),
        ("wave_order", [1.0, 2.0, -3.0]),
        ("wave_order", [1.0, 2.0, 2.5]),
        ("wave_order", [1.0, 2.0, 1001.0]),
        ("fade", [0.0]),
        ("region", []),
    ],
)
def test_arrays_of_no_robot_are_refused_by_name_before_they_reach_the_robots_process(name, values):
    wrong = {"lower": [10.0] * 6, "upper": [-10.0] * 6} if name == "region" else {name: values}
    with pytest.raises(ValueError, match=f"impossible {name}"):
        pack(wavy_model(1.0) | wrong)


@pytest.mark.parametrize(("waves", "nodes"), [(-15.0, 4.0), (15.0, -4.0), (3.5, 1.0), (2e9, 1.0)])
def test_counts_that_do_not_fit_the_numbers_are_refused(waves, nodes):
    values = list(pack(wavy_model(1.0)))
    without = values[:3] + values[3 : -15 - 13 - 12] + values[-13:]
    for of in (values, without):
        with pytest.raises(ValueError, match="correction model"):
            unpack([of[0], waves, nodes, *of[3:]])


ANY_NUMBER = ("offset", "down", "weight", "load", "load_place", "bend", "stretch", "wave_sine", "wave_cosine")
OF_NODES = ("node_place", "node_scale", "node_weight")
SINGULAR = [(0.0, -90.0, 90.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (10.0, -90.0, 2.3, 0.0, 1e-9, 0.0)]


@settings(max_examples=150, deadline=None, derandomize=True)
@given(
    names=st.lists(st.sampled_from(ANY_NUMBER + OF_NODES), min_size=1, max_size=4),
    seed=st.integers(0, 999),
    exponent=st.integers(-3, 8),
    longest_mm=st.sampled_from([0.0, 1.0, 1e5]),
)
def test_every_model_that_is_taken_gives_a_finite_correction_at_any_joints(names, seed, exponent, longest_mm):
    draw = random.Random(seed)
    arrays = {name: list(values) for name, values in wavy_model(1.0).items()}
    arrays["wave_order"] = [1.0, 999.0, 1000.0]
    for name in names:
        arrays[name] = [draw.uniform(-1, 1) * 10**exponent for _ in arrays[name]]
    for name in ("links", "identified"):
        for place in range(3, len(arrays[name]), 16):
            arrays[name][place] = longest_mm
    model = OnlineModel(pack(arrays))
    anywhere = [tuple(draw.uniform(-3600, 3600) for _ in range(6)) for _ in range(3)]
    for readings in [*anywhere, *SINGULAR]:
        for _ in range(3):
            assert all(abs(axis) <= 5.0 + 1e-9 for axis in model.correction(readings))


def test_the_step_is_compiled_once_whatever_the_model_has():
    OnlineModel(pack(wavy_model(1.0)))
    without = {name: [] for name in ("wave_joint", "wave_order", "wave_sine", "wave_cosine", *OF_NODES)}
    assert max(map(abs, OnlineModel(pack(wavy_model(1.0) | without)).correction((0.0, -90.0, 90.0, 0.0, 45.0, 0.0))))
    whole_numbers = {name: [round(v) for v in values] for name, values in wavy_model(0.0).items()}
    assert all(map(math.isfinite, OnlineModel(pack(whole_numbers)).correction(SINGULAR[0])))
    assert len(newton_step.signatures) == 1
