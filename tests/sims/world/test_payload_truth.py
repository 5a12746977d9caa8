"""A payload with its centre of gravity: it turns the joints and bends the tool, by closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sims.bench import catalogue
from sims.conditions import Conditions, Payload
from sims.faults import Faults
from sims.scene.scene import Scene
from sims.world import World
from tests.helpers.sims import BENT, CELL, with_errors

LEVEL = (0.0, -90.0, 90.0, 0.0, 0.0, 0.0)  # the flange's z is level: 5 kg at the tip of the tool bend it most
G = 9.80665


def cell(payload=None, load=None, **errors):
    erring = with_errors(**errors)
    return replace(erring, load=load, simulate=replace(erring.simulate, payload=payload))


def world(payload=None, **errors):
    return World(cell(payload, **errors), 1)


def test_a_payload_at_the_tool_centre_point_turns_the_joints_as_one_without_a_centre():
    one = world(compliance=1)
    here = Conditions(payload_kg=4.0, payload_at=CELL.robot.tool.xyz)
    assert one.true_tcp(BENT, here) == pytest.approx(one.true_tcp(BENT, Conditions(payload_kg=4.0)), abs=1e-9)


def test_a_payload_nearer_to_the_flange_turns_the_joints_less():
    one = world(compliance=1)
    bare, near, far = (
        np.array(one.true_tcp(LEVEL, Conditions(payload_kg=5.0 if at else 0.0, payload_at=at)))
        for at in (None, (0.0, 0.0, 50.0), (0.0, 0.0, 400.0))
    )
    assert 0.1 < np.linalg.norm(near - bare) < np.linalg.norm(far - bare) - 0.05


def test_the_joints_turn_by_the_weights_moment_wherever_it_hangs():
    """One joint alone: torque by the statics of this test, from the moved place of the weight."""
    one, at = world(compliance=1), np.array([100.0, -50.0, 200.0])
    soft, bare = one._compliance, one._compliance.sagged((0.0,) * 6)
    flange = one._geometry.flange
    place = flange[:3, :3] @ at + flange[:3, 3]
    turned = np.subtract(soft.sagged((0.0,) * 6, 2.0, tuple(place)), bare)
    axis = one._chain.arm.axes[1]
    moment = np.cross(place - axis.point, [0.0, 0.0, -2.0 * G]) @ axis.direction
    assert turned[1] == pytest.approx(soft.rates[1] * moment, rel=1e-2)


@pytest.mark.parametrize(("share", "factor"), [(1.0, 1.0), (0.5, 0.3125), (0.0, 0.0), (-0.3, 0.0), (2.0, 2.5)])
def test_a_payload_bends_the_tool_as_a_cantilever(share, factor):
    """At the end c_t l³/3 G; half way 5/16 of it; on a stiff extension twice as far 5/2 of it."""
    one, length = world(deflection=1), CELL.robot.tool.xyz[2]
    at = (0.0, 0.0, share * length)
    bare, loaded = (np.array(one.true_tcp(LEVEL, Conditions(payload_kg=kg, payload_at=at))) for kg in (0.0, 5.0))
    sinks = 0.00036 * (length * 1e-3) ** 3 / 3.0 * 5.0 * G * 1e3
    assert bare - loaded == pytest.approx([0.0, 0.0, factor * sinks], abs=1e-6)


def test_a_robot_carries_what_simulate_says_else_the_cell_files_load():
    load, true = Payload(3.0, (0.0, 0.0, 60.0)), Payload(5.0, (10.0, 0.0, 80.0))
    assert World(cell(load=load), 1).payload == load
    assert World(cell(true, load=load), 1).payload == true
    assert World(cell(), 1).payload == Payload()


def test_the_moving_arm_carries_its_payload_and_truth_without_a_column_is_the_same(kernel):
    payload = Payload(6.0, (20.0, 0.0, 90.0))
    loaded = cell(payload, compliance=1, deflection=1)
    scene = Scene(kernel, loaded, Faults(kernel, catalogue()))
    joints = scene.arm.joints()
    stated = Conditions(payload_kg=6.0, payload_at=(20.0, 0.0, 90.0))
    assert scene.tcp() == pytest.approx(world(compliance=1, deflection=1).true_tcp(joints, stated), abs=1e-9)
    assert scene.tcp() == pytest.approx(scene.world.true_tcp(joints), abs=1e-9)
    assert scene.tcp() != pytest.approx(world(compliance=1, deflection=1).true_tcp(joints), abs=0.1)


def test_the_motors_hold_the_payload_too():
    """Stretched out level, the moment of 5 kg about A2 is known from where they hang: by the amperes for each N·m."""
    at = (0.0, 0.0, 100.0)
    bare, loaded = world(), world(Payload(5.0, at))
    flat = (0.0,) * 6
    more = np.subtract(loaded.holding_currents(flat), bare.holding_currents(flat))
    flange = bare._geometry.flange
    axis = bare._chain.arm.axes[1]
    lever = flange[:3, :3] @ at + flange[:3, 3] - axis.point
    moment_nm = np.cross(lever, [0.0, 0.0, -5.0 * G]) @ axis.direction / 1000.0
    assert abs(moment_nm) > 50.0
    sign = CELL.robot.joints[1].sign
    assert more[1] == pytest.approx(-sign * moment_nm / bare.motors.nm_per_a[1], rel=1e-6)
