"""`calibration.yaml` of the ROS 2 description package of Universal Robots: the pose of each link in the one before.

Its frames (Universal_Robots_ROS2_Description, urdf/ur_macro.xacro): `base_link_inertia` is the controller's base;
`shoulder` … `wrist_3` turn about their own z; `tool0` is `wrist_3`. Lengths in m; roll, pitch, yaw as in URDF, in rad.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

from cellctl.files import InputError, Problem, load_yaml
from cellctl.formats.description import RobotDescription
from cellctl.formats.exports.axes import nearest_on_axis, reading_axes, turned_by
from cellctl.formats.urdf_text import origin_words

if TYPE_CHECKING:
    from cellctl.kinematics import Floats

LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_ROLLS = (0.0, 90.0, 0.0, 0.0, 90.0, -90.0)
"""Roll of each link in the one before, deg, of every robot of this maker; pitch and yaw are 0."""
_CURE = "give a model of a UR robot in its controller's base frame, as the library's (`cellctl robots`)"


@final
@dataclass(frozen=True, eq=False)
class UrCalibration:
    """text: the file. tcp (4, 4): the model's TCP in `tool0`, mm; base (4, 4): the controller's base in its frame."""

    text: str
    tcp: Floats
    base: Floats


def ur_calibration(nominal: RobotDescription, found: RobotDescription, file: str, known: str | None) -> UrCalibration:
    """The file for robot `found` (without deviations), whose maker's table is `nominal`.

    known: the hash of the controller's own calibration, if the user's file has it; else one of this content. Each frame
    is the one on its axis that is nearest to the nominal one, so that no number grows where axes are almost parallel.
    Raises InputError where `nominal` (of `file`) is not built as a UR, or is given in another base frame.
    """
    import numpy as np

    from cellctl.kinematics import inverse_pose

    usual = [*_nominal_frames(nominal, file)[:-1], reading_axes(found).flange]
    axes, z = reading_axes(found), np.array([0.0, 0.0, 1.0])
    frames = [np.eye(4)]
    for frame, point, along in zip(usual, axes.points, axes.along, strict=True):
        frames.append(nearest_on_axis(frame, point, along, z))
    lines = ["kinematics:"]
    for name, before, frame in zip(LINKS, frames, frames[1:], strict=False):
        xyz, rpy = origin_words(inverse_pose(before) @ frame)
        keys = ("x", "y", "z", "roll", "pitch", "yaw")
        lines += [f"  {name}:", *(f"    {key}: {word}" for key, word in zip(keys, (*xyz, *rpy), strict=True))]
    content = "".join(f"{line}\n" for line in lines)
    name = known or f"calib_{int(hashlib.sha256(content.encode()).hexdigest()[:16], 16)}"
    tcp = inverse_pose(frames[-1]) @ axes.flange @ found.chain.tool_now
    return UrCalibration(f"{content}  hash: {name}\n", tcp, found.chain.base_now)


def hash_of(path: Path) -> str:
    """The hash in the user's own calibration file: that of the controller. Raises InputError where it has none."""
    content = load_yaml(path).data
    section = content.get("kinematics") if isinstance(content, dict) else None
    known = section.get("hash") if isinstance(section, dict) else None
    if not isinstance(known, str) or not known.startswith("calib_"):
        cure = "give the file that ur_calibration read from the controller, or leave --into out"
        raise InputError(Problem(str(path), 0, 0, "has no hash of a calibration under kinematics", cure))
    return known


def _nominal_frames(nominal: RobotDescription, file: str) -> list[Floats]:
    """The maker's frames (4, 4) at readings 0, in the controller's base frame, if the robot is built as a UR."""
    import numpy as np

    from cellctl.kinematics import LinkTable, inverse_pose, pose, pose_from_xyz_abc, to_mdh

    joints = nominal.joint_map()
    if joints.n != len(LINKS) or (joints.sign != 1.0).any():
        what = f"is no UR robot: it has {joints.n} joints, with readings counted {_senses(joints.sign)}"
        raise InputError(Problem(file, 0, 0, what, _CURE))
    chain = to_mdh(nominal.chain)
    assert isinstance(chain.table, LinkTable)
    behind = inverse_pose(nominal.chain.base) @ chain.frames(joints.model(np.zeros(joints.n)))[:-1]
    frames = [frame @ pose(np.eye(3), [0.0, 0.0, row.d]) for frame, row in zip(behind, chain.table.links, strict=True)]
    for name, roll, before, frame in zip(LINKS, _ROLLS, [np.eye(4), *frames], frames, strict=False):
        apart = np.degrees(turned_by(pose_from_xyz_abc([0.0] * 3, [0.0, 0.0, roll]), inverse_pose(before) @ frame))
        if apart > 1.0:
            what = f"is no UR robot: {name} is turned by {apart:.0f}° from where the description package has it"
            raise InputError(Problem(file, 0, 0, what, _CURE))
    return frames


def _senses(sign: Floats) -> str:
    return "against the model" if (sign < 0.0).any() else "with the model"
