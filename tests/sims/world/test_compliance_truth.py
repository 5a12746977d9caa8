"""Joints that turn under gravity: against closed forms, and against the least energy of a link table computed here."""

from __future__ import annotations

from dataclasses import replace
from math import cos, radians, sin

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from sims.cell import ERRORS
from sims.conditions import Conditions
from sims.world._gravity import Body, Compliance, Falls, Mass
from sims.world.kinematics import Axis
from tests.helpers.sims import BENT, CELL, world

READINGS = st.tuples(*[st.floats(joint.min, joint.max) for joint in CELL.robot.joints])
STRETCHED = (0.0,) * 6
G = 9.80665

LEVEL = Axis(point=(0.0, 0.0, 100.0), direction=(0.0, 1.0, 0.0))


def frames(model_angles):
    """Every link's frame, 4×4, of the nominal robot at model angles (rad) beyond its table's."""
    T, found = np.eye(4), []
    for link, angle in zip(CELL.robot.links, model_angles, strict=True):
        th, al = radians(link.theta) + angle, radians(link.alpha)
        T = T @ np.array(
            [
                [cos(th), -sin(th) * cos(al), sin(th) * sin(al), link.a * cos(th)],
                [sin(th), cos(th) * cos(al), -cos(th) * sin(al), link.a * sin(th)],
                [0, sin(al), cos(al), link.d],
                [0, 0, 0, 1],
            ]
        )
        found.append(T)
    return found


@pytest.mark.parametrize("commanded", [0.0, 0.4, -1.0, 1.3])
@pytest.mark.parametrize("rate", [1e-9, 6e-6])
def test_a_single_joint_rests_where_spring_and_weight_hold_each_other_at_the_sagged_angle(commanded, rate):
    one = Compliance(Body((Mass(100.0, (500.0, 0.0, 100.0)),), (rate,)), [LEVEL], (800.0, 0.0, 100.0), 1.0)
    expected = brentq(lambda sag: sag - rate * 100.0 * 500.0 * cos(commanded + sag), -2.0, 2.0, xtol=1e-14)
    (rests,) = one.sagged([commanded])
    assert rests - commanded == pytest.approx(expected, abs=1e-12)
    if rate > 1e-6:
        assert abs(expected - rate * 100.0 * 500.0 * cos(commanded)) > 1e-3  # the linear answer is another


def test_a_payload_hangs_on_the_tool_centre_point():
    bare = Compliance(Body((Mass(0.0, (0.0, 0.0, 0.0)),), (1e-8,)), [LEVEL], (800.0, 0.0, 100.0), 1.0)
    assert bare.sagged([0.0]) == [0.0]
    assert bare.sagged([0.0], 3.0)[0] == pytest.approx(1e-8 * 3.0 * G * 800.0, rel=1e-6)


def test_drives_that_cannot_hold_their_arm_are_said_to_fall():
    soft = Compliance(Body((Mass(100.0, (500.0, 0.0, 100.0)),), (1e-3,)), [LEVEL], (800.0, 0.0, 100.0), 1.0)
    with pytest.raises(Falls):
        soft.sagged([0.3])


@given(READINGS, st.integers(1, 20), st.sampled_from([(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.48, -0.6, 0.64)]))
@settings(max_examples=40)
def test_the_sagged_arm_has_the_least_energy_of_weight_and_springs(readings, seed, down):
    soft = world(seed, replace(CELL, robot=replace(CELL.robot, down=down)), compliance=1)._compliance
    drives = np.radians([joint.sign * reading for joint, reading in zip(CELL.robot.joints, readings, strict=True)])
    homes = [np.linalg.inv(T) @ [*mass.centre, 1.0] for T, mass in zip(frames((0.0,) * 6), soft._links, strict=True)]

    def energy(angles):
        heights = [-(T @ home)[:3] @ down for T, home in zip(frames(angles), homes, strict=True)]
        springs = (np.asarray(angles) - drives) ** 2 / soft.rates / 2.0
        return np.dot([mass.weight_n for mass in soft._links], heights) + springs.sum()

    rest = np.array(soft.sagged(drives))
    for step in np.eye(6) * 1e-4:
        slope = (energy(rest + step) - energy(rest - step)) / 2e-4
        assert slope == pytest.approx(0.0, abs=2e-2)  # N·mm, of some 100 000


def test_upper_arm_and_forearm_sag_by_tenths_of_a_milliradian_stretched_out():
    sags = np.array([world(seed, compliance=1)._compliance.sagged(STRETCHED) for seed in range(1, 25)])
    upper_arm, forearm = sags[:, 1] * 1e3, sags[:, 2] * 1e3
    assert np.all((upper_arm > 0.15) & (upper_arm < 0.5))
    assert np.all((forearm > 0.08) & (forearm < 0.5))
    assert 0.2 < upper_arm.mean() < 0.45
    assert np.abs(sags[:, 0]).max() < 1e-9  # its axis stands upright


def test_the_tip_sinks_by_the_better_part_of_a_millimetre_and_more_under_load():
    for seed in range(1, 10):
        rigid = world(seed).true_tcp(STRETCHED)
        soft, loaded = (world(seed, compliance=1).true_tcp(STRETCHED, Conditions(payload_kg=kg)) for kg in (0.0, 5.0))
        assert -1.5 < soft[2] - rigid[2] < -0.3
        assert -1.5 < loaded[2] - soft[2] < -0.2


def test_without_compliance_a_payload_changes_nothing():
    assert world().true_tcp(BENT, Conditions(payload_kg=5.0)) == world().true_tcp(BENT)


def test_twice_the_compliance_is_nearly_twice_the_sag():
    rigid, one, two = (np.array(world(compliance=scale).true_tcp(BENT)) for scale in (0, 1, 2))
    assert two - rigid == pytest.approx(2 * (one - rigid), rel=2e-2, abs=1e-3)


def test_masses_and_stiffness_are_the_same_whatever_else_is_wrong():
    alone, among = world(compliance=1)._compliance, world(**dict.fromkeys(ERRORS, 1))._compliance
    assert alone._links == among._links
    assert alone.rates == among.rates


@given(READINGS)
@settings(max_examples=25)
def test_at_rest_the_arm_turned_back_by_its_sag_is_where_it_was_told_to_be(readings):
    """Two robots, one told to be at `readings`, the other rigid at the first one's sagged angles, are in one place."""
    soft = world(compliance=1)
    signs = [joint.sign for joint in CELL.robot.joints]
    angles = [radians(sign * reading) for sign, reading in zip(signs, readings, strict=True)]
    there = [float(np.degrees(a)) * sign for a, sign in zip(soft._compliance.sagged(angles), signs, strict=True)]
    assert world().true_tcp(there) == pytest.approx(soft.true_tcp(readings), abs=1e-8)
