"""An identified robot in the forms of other people's systems: planners, UR, KUKA, ABB and FANUC controllers."""

from cellctl.formats.exports.controllers import abb_text, fanuc_text, kuka_text
from cellctl.formats.exports.joint_zeros import JointZeros, joint_zeros
from cellctl.formats.exports.left_out import Cost, costs_of, effects_left_out, measured_postures
from cellctl.formats.exports.ur_calibration import hash_of, ur_calibration
from cellctl.formats.exports.urdf_into import urdf_into

__all__ = [
    "Cost",
    "JointZeros",
    "abb_text",
    "costs_of",
    "effects_left_out",
    "fanuc_text",
    "hash_of",
    "joint_zeros",
    "kuka_text",
    "measured_postures",
    "ur_calibration",
    "urdf_into",
]
