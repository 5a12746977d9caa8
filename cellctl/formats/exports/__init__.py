"""An identified robot in the forms of other people's systems: planners, UR, KUKA, ABB and FANUC controllers."""

from cellctl.formats.exports.controllers import abb_text, fanuc_text, kuka_text
from cellctl.formats.exports.fitted_forms import FittedForm, fitted_geometry
from cellctl.formats.exports.joint_zeros import JointZeros, joint_zeros
from cellctl.formats.exports.left_out import Cost, effects_left_out
from cellctl.formats.exports.ur_calibration import hash_of, ur_calibration
from cellctl.formats.exports.urdf_into import urdf_into
from cellctl.formats.measured_postures import measured_postures

__all__ = [
    "Cost",
    "FittedForm",
    "JointZeros",
    "abb_text",
    "effects_left_out",
    "fanuc_text",
    "fitted_geometry",
    "hash_of",
    "joint_zeros",
    "kuka_text",
    "measured_postures",
    "ur_calibration",
    "urdf_into",
]
