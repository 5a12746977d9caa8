"""The motors of the true arm: torque from the weight's height, friction by the direction of motion."""

import numpy as np
import pytest

from sims.conditions import Payload
from sims.world._gravity import GRAVITY_M_S2, Mass, drawn_body
from sims.world.drives import PRESLIDING_DEG, slid
from sims.world.kinematics import nominal_geometry
from sims.world.world import World
from tests.helpers.own_model import turn
from tests.helpers.sims import with_errors

POSE = (20.0, -60.0, 70.0, 35.0, -40.0, 100.0)
SEED = 7


@pytest.fixture(scope="module")
def cell():
    return with_errors()


def potential_j(robot, links, axes, readings):
    """Weight times height of every link, N·m, by turning each centre about all axes before it."""
    total = 0.0
    for number, link in enumerate(links):
        centre = np.array(link.centre)
        for joint, axis, reading in reversed(list(zip(robot.joints, axes, readings, strict=True))[: number + 1]):
            angle = np.radians(joint.sign * reading + joint.offset)
            centre = (turn(axis.direction, angle, axis.point) @ [*centre, 1.0])[:3]
        total -= link.weight_n * 1e-3 * float(np.array(robot.down) @ centre)
    return total


def by_virtual_work(robot, links, axes, readings):
    """N·m of each axis: how the potential energy changes with its reading."""
    found = []
    for axis in range(len(readings)):
        ends = []
        for step in (1e-3, -1e-3):
            moved = list(readings)
            moved[axis] += step
            ends.append(potential_j(robot, links, axes, moved))
        found.append((ends[0] - ends[1]) / np.radians(2e-3))
    return found


def test_the_torque_of_each_motor_is_the_change_of_height_of_what_it_carries(cell):
    world, nominal = World(cell, SEED), nominal_geometry(cell.robot)
    links = drawn_body(cell.robot, nominal, SEED).links
    torques = np.multiply(world.holding_currents(POSE), world.motors.nm_per_a)
    assert torques == pytest.approx(by_virtual_work(cell.robot, links, nominal.axes, POSE), abs=1e-4)
    assert abs(torques[1]) > 30.0  # the weight of the links, not only the tool's


def test_a_payload_adds_the_moment_of_its_weight(cell):
    world, nominal = World(cell, SEED), nominal_geometry(cell.robot)
    body = drawn_body(cell.robot, nominal, SEED)
    payload = Mass(5.0 * GRAVITY_M_S2, (1200.0, 40.0, 900.0))
    loaded = (*body.links[:-1], body.links[-1].together(payload))
    torques = np.multiply(world.motors.holding(world._angles(POSE, Payload()), payload), world.motors.nm_per_a)
    assert torques == pytest.approx(by_virtual_work(cell.robot, loaded, nominal.axes, POSE), abs=1e-4)


def test_every_motor_holds_its_greatest_moment_below_its_rated_current(cell):
    world, random = World(cell, SEED), np.random.default_rng(1)
    low, high = zip(*((joint.min, joint.max) for joint in cell.robot.joints), strict=True)
    currents = [np.abs(world.holding_currents(pose)) for pose in random.uniform(low, high, (200, 6))]
    assert np.all(np.max(currents, axis=0) < world.motors.rated_a)


def test_another_seed_is_another_set_of_motors(cell):
    one, same, other = (World(cell, seed).motors for seed in (SEED, SEED, SEED + 1))
    assert one.nm_per_a == same.nm_per_a != other.nm_per_a


def test_friction_has_the_sign_of_the_last_motion_and_grows_within_the_presliding_way():
    up = slid((0.0, 0.0), (10.0, 10.0), (11.0, 10.0))
    assert up == (1.0, 0.0)
    turning = slid(up, (11.0, 10.0), (11.0 - PRESLIDING_DEG / 2.0, 10.0))
    assert turning == pytest.approx((0.5, 0.0))
    assert slid(turning, (11.0, 10.0), (9.0, 9.0)) == (-1.0, -1.0)


def test_friction_adds_to_the_weight_with_the_way_of_the_axis(cell):
    motors = World(cell, SEED).motors
    up, down = motors.friction((1.0,) * 6, (10.0,) * 6), motors.friction((-1.0,) * 6, (-10.0,) * 6)
    at_rest = motors.friction((1.0,) * 6, (0.0,) * 6)
    assert up == pytest.approx([-value for value in down])
    assert all(moving > resting > 0.2 for moving, resting in zip(up, at_rest, strict=True))
