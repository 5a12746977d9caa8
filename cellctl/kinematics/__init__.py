"""Kinematics of serial robots: link tables, forward and inverse, closed-form Jacobians, frames. mm and rad."""

from cellctl.kinematics.arrays import Bools, Floats
from cellctl.kinematics.chain import SerialChain
from cellctl.kinematics.elementary import CONVENTIONS, Convention, Link
from cellctl.kinematics.frames import (
    abc_from_rotation,
    inverse_pose,
    pose,
    pose_from_xyz_abc,
    rotation_from_abc,
    rotation_from_quaternion,
    rotation_vector,
)
from cellctl.kinematics.inverse import InverseResult, inverse
from cellctl.kinematics.joint_map import JointMap

__all__ = [
    "CONVENTIONS",
    "Bools",
    "Convention",
    "Floats",
    "InverseResult",
    "JointMap",
    "Link",
    "SerialChain",
    "abc_from_rotation",
    "inverse",
    "inverse_pose",
    "pose",
    "pose_from_xyz_abc",
    "rotation_from_abc",
    "rotation_from_quaternion",
    "rotation_vector",
]
