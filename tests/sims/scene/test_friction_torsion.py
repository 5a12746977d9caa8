"""Joints that lag behind by their motor's whole torque, friction included, and joints that lag by the weight alone."""

import numpy as np
import pytest

from sims.bench import catalogue
from sims.cell import read_cell
from sims.conditions import Conditions, Payload
from sims.faults import Faults
from sims.scene.scene import Scene
from sims.world.world import World
from tests.helpers.sims import with_errors

POSE = (20.0, -60.0, 70.0, 35.0, -40.0, 100.0)
WAYS = (1, -1, -1, 1, 1, -1)
SEED = 7


@pytest.fixture(scope="module")
def cell(request):
    return read_cell(request.config.rootpath / "procedures/cells/sphere_cell.yaml")


def lag_rad(cell, ways):
    """How far each link is behind its reading (6,), in the direction of the reading."""
    one, rigid = World(cell, SEED), World(with_errors(cell), SEED)
    signs = [joint.sign for joint in cell.robot.joints]
    links = one._angles(one.links_after(POSE, ways), Payload())
    return np.multiply(signs, np.subtract(rigid._angles(POSE, Payload()), links))


@pytest.mark.parametrize("ways", [WAYS, (-1,) * 6, (0,) * 6])
def test_with_all_friction_in_the_springs_every_joint_lags_in_proportion_to_its_motor_current(cell, ways):
    cell = with_errors(cell, compliance=3, friction_torsion=1)
    world = World(cell, SEED)
    flexibility = np.multiply(world._compliance.rates, world.motors.nm_per_a) * 1e3  # rad/A
    weight = world.motors.holding(world._angles(POSE, Payload()))
    current = np.add(weight, world.motors.friction(ways, (0.0,) * 6))
    assert lag_rad(cell, ways) == pytest.approx(flexibility * current, rel=1e-3, abs=1e-7)


def test_without_it_the_joints_lag_by_the_weight_alone(cell):
    cell = with_errors(cell, compliance=3)
    assert np.array_equal(lag_rad(cell, WAYS), lag_rad(cell, (0,) * 6))


def test_stiff_drives_do_not_wind_up(cell):
    assert World(with_errors(cell, friction_torsion=1), SEED).wound_up == ()


def test_an_arm_at_rest_lags_as_it_does_in_the_truth_for_its_way_of_approach(cell, kernel):
    cell = with_errors(cell, compliance=3, friction_torsion=1, backlash=1)
    arm = Scene(kernel, cell, Faults(kernel, catalogue())).arm
    for target in (tuple(p - 3.0 * way for p, way in zip(POSE, WAYS, strict=True)), POSE):
        arm.move(target, 50.0, lambda: None)
        kernel.at(arm._motion.end_ns + 1, kernel.stop)
        kernel.run()
        kernel._running = True
    world = World(cell, cell.simulate.seed)
    assert arm.links(kernel.now) == pytest.approx(world.links_after(POSE, WAYS), abs=1e-9)
    assert arm.tcp(kernel.now) == pytest.approx(world.true_tcp(POSE, Conditions(WAYS)), abs=1e-6)
    assert np.linalg.norm(np.subtract(arm.tcp(kernel.now), world.true_tcp(POSE))) > 0.05
