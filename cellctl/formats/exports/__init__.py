"""An identified robot in the forms of other people's systems: planners, UR, KUKA, ABB and FANUC controllers."""

from cellctl.formats.exports._controllers import JointZeros, abb_text, fanuc_text, joint_zeros, kuka_text
from cellctl.formats.exports._fitted_forms import Cost, FittedForm, effects_left_out, fitted_geometry
from cellctl.formats.exports._urdf_and_ur import (
    UR_LINKS,
    ReadingAxes,
    hash_of,
    reading_axes,
    turned_by,
    ur_calibration,
    urdf_into,
)
from cellctl.formats.table_making import measured_postures

__all__ = [
    "UR_LINKS",
    "Cost",
    "FittedForm",
    "JointZeros",
    "ReadingAxes",
    "abb_text",
    "effects_left_out",
    "fanuc_text",
    "fitted_geometry",
    "hash_of",
    "joint_zeros",
    "kuka_text",
    "measured_postures",
    "reading_axes",
    "turned_by",
    "ur_calibration",
    "urdf_into",
]
