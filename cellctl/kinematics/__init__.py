"""Kinematics of serial robots: tables and axes, forward and inverse, closed-form Jacobians, frames. mm and rad."""

from cellctl.kinematics._chain import CONVENTIONS, MM_PER_M, Convention, SerialChain
from cellctl.kinematics._conversion import settled, to_craig, to_mdh, to_poe
from cellctl.kinematics._frames import (
    Bools,
    Floats,
    abc_from_rotation,
    inverse_pose,
    pose,
    pose_difference,
    pose_from_xyz_abc,
    rotation_from_abc,
    rotation_from_quaternion,
    rotation_vector,
)
from cellctl.kinematics.controller_readings import JointMap, JointUnit
from cellctl.kinematics.geometry import AxisTable, JointAxis, Link, LinkTable, TableConvention
from cellctl.kinematics.inverse import InverseResult, inverse, inverse_from_all, nearest_turn
from cellctl.kinematics.low_discrepancy import spread_over

__all__ = [
    "CONVENTIONS",
    "MM_PER_M",
    "AxisTable",
    "Bools",
    "Convention",
    "Floats",
    "InverseResult",
    "JointAxis",
    "JointMap",
    "JointUnit",
    "Link",
    "LinkTable",
    "SerialChain",
    "TableConvention",
    "abc_from_rotation",
    "inverse",
    "inverse_from_all",
    "inverse_pose",
    "nearest_turn",
    "pose",
    "pose_difference",
    "pose_from_xyz_abc",
    "rotation_from_abc",
    "rotation_from_quaternion",
    "rotation_vector",
    "settled",
    "spread_over",
    "to_craig",
    "to_mdh",
    "to_poe",
]
