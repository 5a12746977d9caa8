"""Status and turn of a taught position lead back to the posture in which it was taught."""

import numpy as np
import pytest

from cellctl.compensation.postures import stated_posture
from cellctl.formats import RobotFile
from cellctl.kinematics.controller_readings import status_of, turn_of
from tests.helpers.arms import KR5_FILE

FILE = RobotFile.load(KR5_FILE)
CHAIN, JOINTS, LIMITS = FILE.chain(), FILE.joint_map(), FILE.limits()
FAR = np.zeros(6)


def random_readings(count):
    """All over the joints, the wrist's whole turns included; not near a singularity."""
    rng = np.random.default_rng(3)
    drawn = rng.uniform(LIMITS[:, 0], LIMITS[:, 1], (20 * count, 6))
    pose = CHAIN.tool_jacobian(JOINTS.model(drawn))
    pose[:, :3] /= CHAIN.reach_mm
    return drawn[np.linalg.svd(pose, compute_uv=False)[:, -1] > 0.03][:count]


@pytest.mark.parametrize("readings", random_readings(12))
def test_a_taught_position_has_its_posture_again(readings):
    pose = CHAIN.forward(JOINTS.model(readings))
    status, turn = int(status_of(CHAIN, JOINTS, readings)), int(turn_of(readings))
    found = stated_posture(CHAIN, JOINTS, LIMITS, pose, FAR, status=status, turn=turn)
    assert found is not None
    assert turn_of(found) == turn
    np.testing.assert_allclose((found - readings + 180.0) % 360.0, 180.0, atol=1e-6)


def test_without_status_and_turn_it_is_the_posture_nearest_to_the_one_before():
    readings = np.array([10.0, -60.0, 80.0, 30.0, 50.0, 20.0])
    found = stated_posture(CHAIN, JOINTS, LIMITS, CHAIN.forward(JOINTS.model(readings)), readings + 2.0)
    np.testing.assert_allclose(found, readings, atol=1e-6)


def test_contradicting_status_and_turn_are_of_no_posture():
    readings = np.array([10.0, -60.0, 80.0, 30.0, 50.0, 20.0])
    pose = CHAIN.forward(JOINTS.model(readings))
    assert stated_posture(CHAIN, JOINTS, LIMITS, pose, FAR, status=6, turn=int(turn_of(readings))) is None


def test_a_higher_bit_of_the_status_does_not_matter():
    readings = np.array([10.0, -60.0, 80.0, 30.0, 50.0, 20.0])
    pose, status = CHAIN.forward(JOINTS.model(readings)), int(status_of(CHAIN, JOINTS, readings))
    found = stated_posture(CHAIN, JOINTS, LIMITS, pose, FAR, status=status | 8, turn=int(turn_of(readings)))
    np.testing.assert_allclose(found, readings, atol=1e-6)
