"""A UR10e as its maker calibrated it, errors of it, and points of its programs; forms of UR's calibrations.

The numbers of programs are written here by scipy's rotations, those of calibrations chained by products.
"""

from __future__ import annotations

import math

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from cellctl.formats import ModelFile
from cellctl.kinematics import Floats
from cellctl.robot_file import MakersCalibration, RobotFile, Tool
from tests.helpers.arms import library_robot, model_of
from tests.helpers.own_model import X, Y, Z, slide, turn

TOOL_MM = 150.0
SHEET = library_robot("ur10e").model_copy(update={"tool": Tool(xyz=[0.0, 0.0, TOOL_MM])})
ROBOT = SHEET.model_copy(update={"calibration": MakersCalibration(file="calibration.conf")})
ERRORS = {"theta2": 4e-4, "theta3": -6e-4, "theta5": 5e-4, "a2": 0.4, "d4": -0.3}
CORNER = np.array([10.0, -80.0, 100.0, -110.0, -90.0, 5.0])
SET_TCP = f"  set_tcp(p[0, 0, {TOOL_MM / 1000}, 0, 0, 0])\n"


def model(robot: RobotFile = ROBOT) -> ModelFile:
    start = {"base": np.eye(4).tolist(), "tool": robot.chain().tool.tolist()}
    return model_of(robot, ERRORS).model_copy(update={"start": start})


MODEL = model()
CHAIN = ROBOT.chain()


def six(pose: Floats) -> Floats:
    """x, y, z, rx, ry, rz, m and rad, of a pose (4, 4), mm."""
    return np.concatenate([pose[:3, 3] / 1000.0, Rotation.from_matrix(pose[:3, :3]).as_rotvec()])


def pose_at(readings: Floats) -> Floats:
    return CHAIN.forward(np.radians(readings))


def shifted(dx: float, dy: float = 0.0, dz: float = 0.0) -> Floats:
    found = pose_at(CORNER).copy()
    found[:3, 3] += [dx, dy, dz]
    return found


def p(pose: Floats) -> str:
    return f"p[{', '.join(f'{value:.12f}' for value in six(pose))}]"


def q(readings: Floats) -> str:
    return f"[{', '.join(f'{value:.12f}' for value in np.radians(readings))}]"


HOME = q(CORNER - 5.0)


LINKS = ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]


def tool0(text, readings_deg):
    """`tool0` in the controller's base, mm, as the description package chains these numbers."""
    links, here = yaml.safe_load(text)["kinematics"], np.eye(4)
    for name, reading in zip(LINKS, readings_deg, strict=True):
        row = links[name]
        here = here @ slide([1000.0 * row[key] for key in "xyz"])
        here = (
            here @ turn(Z, row["yaw"]) @ turn(Y, row["pitch"]) @ turn(X, row["roll"]) @ turn(Z, math.radians(reading))
        )
    return here


FACTORY_DH = [
    (-2.4147806894359e-07, 180.539811714259, 0.0212234865571206, 1.57014608044242),
    (1.60233952386695, 439140.974079901, 19.3171326277006, 0.0013941666682559),
    (-1.68607190752171, -446027.059806332, -569.251663611088, 0.00693818880325995),
    (0.0837331147700119, 7060.3368964236, -0.0461409023720934, 1.56998468543761),
    (-1.01260355871158e-07, 119.811341150314, -0.0639280053471802, -1.57038520649543),
    (3.91986209186124e-08, 115.670917257426, 0.0, 0.0),
]
"""theta, d, a, alpha of a real UR10e's factory calibration, mm and rad, with links of 440 m: from the documentation of
ur_calibration (Universal_Robots_ROS2_Driver, ur_calibration/doc/algorithm.rst)."""
