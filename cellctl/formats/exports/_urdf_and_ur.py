"""Robots for ROS: calibrated joint origins in the user's own URDF, and `calibration.yaml` of Universal Robots.

A form that gives each link a frame on its joint's axis leaves two choices open: where along the axis, and how turned
about it. The nearest to the nominal frame keeps every number near its nominal value, also where axes are almost
parallel: their common perpendicular, which a DH table needs, may be hundreds of metres away.

Meshes, inertias and collision shapes are given in the link frames. So each link frame moves only as far as its joint's
axis demands: the least turn and shift. What remains at the tip goes into the fixed joint behind the last turning one.

Its frames (Universal_Robots_ROS2_Description, urdf/ur_macro.xacro): `base_link_inertia` is the controller's base;
`shoulder` … `wrist_3` turn about their own z; `tool0` is `wrist_3`. Lengths in m; roll, pitch, yaw as in URDF, in rad.
"""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from cellctl.files import InputError, Problem, load_yaml
from cellctl.formats.description import RobotDescription
from cellctl.formats.urdf import UrdfChain, UrdfJoint, load_chain, origin_words
from cellctl.kinematics import Floats, LinkTable, inverse_pose, pose, pose_from_xyz_abc, rotation_vector, to_mdh


@final
@dataclass(frozen=True, eq=False)
class ReadingAxes:
    """The axes where all readings are 0, in the robot's base frame, mm.

    points (n, 3): one on each axis. along (n, 3): unit vectors; a growing reading turns right-handed about it. flange
    (4, 4). The flange at readings r is the product of the turns by r about these axes, times `flange`.
    """

    points: Floats
    along: Floats
    flange: Floats


def reading_axes(robot: RobotDescription) -> ReadingAxes:
    """The axes of a robot without deviations (`RobotDescription.of`)."""
    joints = robot.joint_map()
    frames = robot.chain.with_base(np.eye(4)).frames(joints.model(np.zeros(joints.n)))
    return ReadingAxes(frames[:-1, :3, 3], frames[:-1, :3, 2] * joints.sign[:, None], frames[-1])


def nearest_on_axis(frame: Floats, point: Floats, along: Floats, axis: Floats) -> Floats:
    """The pose (4, 4) nearest to `frame` that lies on the line through `point` along `along` (unit vector).

    Its origin is on the line, and its direction `axis` (in its own frame, unit vector) is `along`: the least turn and
    the least shift that do so. Raises ValueError where `axis` points against `along`.
    """
    before = frame[:3, :3] @ axis
    cosine = float(before @ along)
    if cosine < -0.5:
        raise ValueError("the axis points the other way")
    x, y, z = np.cross(before, along)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(3) + skew + skew @ skew / (1.0 + cosine)
    origin = point + float((frame[:3, 3] - point) @ along) * along
    return pose(turn @ frame[:3, :3], origin)


def turned_by(frame: Floats, other: Floats) -> float:
    """Angle between two poses (4, 4), rad."""
    return float(np.linalg.norm(rotation_vector(frame[:3, :3].T @ other[:3, :3])))


NEAR_DEG, NEAR_MM = 1.0, 5.0
"""The axes of the user's URDF lie this near to those of the model's robot file, or it is another robot."""
_TAG_END = re.compile(rb"""(?:[^>"']|"[^"]*"|'[^']*')*>""")
_ORIGIN_ATTRIBUTE = re.compile(rb"""\s+(?:xyz|rpy)\s*=\s*(?:"[^"]*"|'[^']*')""")


def urdf_into(
    path: Path, nominal: RobotDescription, found: RobotDescription, tip: str | None = None
) -> tuple[bytes, str | None]:
    """The URDF at `path` with the joint origins of robot `found`; and in words what the tip still lacks, or None.

    `nominal` is the robot that the URDF describes: it tells where the URDF's root is. The tip is at the place that the
    nominal robot's flange and the URDF give it relative to the flange. Raises InputError, naming each joint, where the
    URDF is another robot, or counts its joints otherwise.
    """
    chain = load_chain(path, tip)
    _refuse_prismatic(str(path), chain)
    links = _link_frames(chain.joints)
    usual = reading_axes(nominal)
    root = _root_of_base(str(path), chain, links, usual)
    goal = _moved(reading_axes(found), root)
    behind_flange = inverse_pose(root @ usual.flange) @ links[-1]
    if np.linalg.norm(behind_flange[:3, 3]) < NEAR_MM and np.degrees(turned_by(np.eye(4), behind_flange)) < NEAR_DEG:
        behind_flange = np.eye(4)  # the tip is the flange, in a URDF with slightly other lengths
    wished = goal.flange @ behind_flange
    last = max(index for index, joint in enumerate(chain.joints) if joint.axis is not None)
    links[last] = wished @ inverse_pose(inverse_pose(links[last]) @ links[-1])
    origins, rest = _origins(chain.joints, links, goal)
    if last + 1 < len(chain.joints):
        origins[last + 1] = rest @ origins[last + 1]
        return _edited(path, chain, origins), None
    return _edited(path, chain, origins), _lacking(chain.joints[last].child, rest)


def _link_frames(joints: Iterable[UrdfJoint]) -> list[Floats]:
    """Pose of each joint's child link (4, 4) in the root link at positions 0, mm."""
    return list(itertools.accumulate((joint.origin for joint in joints), np.matmul))


def _origins(joints: tuple[UrdfJoint, ...], wished: list[Floats], goal: ReadingAxes) -> tuple[list[Floats], Floats]:
    """Each joint's new origin (4, 4), and the pose of the last turning link's wished frame in its frame."""
    here, rest, origins, turned = np.eye(4), np.eye(4), [], 0
    for joint, frame in zip(joints, wished, strict=True):
        step = joint.origin
        if joint.axis is not None:
            place = nearest_on_axis(frame, goal.points[turned], goal.along[turned], joint.axis)
            step, rest, turned = inverse_pose(here) @ place, inverse_pose(place) @ frame, turned + 1
        origins.append(step)
        here = here @ step
    return origins, rest


def _root_of_base(file: str, chain: UrdfChain, links: list[Floats], usual: ReadingAxes) -> Floats:
    """Pose of the nominal robot's base (4, 4) in the URDF's root link, at which their axes coincide."""
    pairs = zip(chain.joints, links, strict=True)
    placed = [(joint, frame[:3, 3], frame[:3, :3] @ joint.axis) for joint, frame in pairs if joint.axis is not None]
    if len(placed) != len(usual.points):
        cure = "name the robot's last link with --tip, or give the URDF of this robot"
        what = f"has {len(placed)} turning joints up to the tip, and the robot {len(usual.points)}"
        raise InputError(Problem(file, 0, 0, what, cure))
    points, along = (np.array([each[part] for each in placed]) for part in (1, 2))
    left, sizes, right = np.linalg.svd(along.T @ usual.along)
    if sizes[1] < 1e-6:
        what = "all its joints are parallel: the place of its base cannot be told"
        raise InputError(Problem(file, 0, 0, what, "write a URDF of its own, without --into"))
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    apart = np.einsum("nij,nj->ni", across, points - usual.points @ turn.T)
    shift = np.linalg.lstsq(across.reshape(-1, 3), apart.ravel(), rcond=None)[0]
    off_mm = np.linalg.norm(apart - across @ shift, axis=1)
    off_deg = np.degrees(np.arccos(np.clip(np.sum(along * (usual.along @ turn.T), axis=1), -1.0, 1.0)))
    _refuse_others(file, [each[0] for each in placed], off_deg, off_mm)
    return pose(turn, shift)


def _refuse_prismatic(file: str, chain: UrdfChain) -> None:
    problems = [
        Problem(file, joint.element.line, 0, f"joint '{joint.name}' is prismatic", "write a URDF without --into")
        for joint in chain.joints
        if joint.stated is not None and joint.stated.prismatic
    ]
    if problems:
        raise InputError(problems)


def _refuse_others(file: str, joints: list[UrdfJoint], off_deg: Floats, off_mm: Floats) -> None:
    cure = "give the URDF of this robot, with joints counted as the controller does (sense and zero)"
    problems = []
    for joint, deg, mm in zip(joints, off_deg.tolist(), off_mm.tolist(), strict=True):
        if deg > NEAR_DEG or mm > NEAR_MM:
            what = f"the axis of joint '{joint.name}' is {deg:.1f}° and {mm:.1f} mm from the robot's"
            problems.append(Problem(file, joint.element.line, 0, what, cure))
    if problems:
        raise InputError(problems)


def _moved(axes: ReadingAxes, root: Floats) -> ReadingAxes:
    turn = root[:3, :3]
    return ReadingAxes(axes.points @ turn.T + root[:3, 3], axes.along @ turn.T, root @ axes.flange)


def _lacking(link: str, rest: Floats) -> str | None:
    shift, turn = float(np.linalg.norm(rest[:3, 3])), float(np.degrees(turned_by(np.eye(4), rest)))
    if shift < 1e-9 and turn < 1e-9:
        return None
    return f"{shift:.3f} mm and {turn:.4f}° at link '{link}': no fixed joint behind the last turning one can hold them"


def _edited(path: Path, chain: UrdfChain, origins: list[Floats]) -> bytes:
    """The file's bytes with these origins; a joint whose origin is what it was keeps its text."""
    data = path.read_bytes()
    pairs = zip(chain.joints, origins, strict=True)
    edits = [_edit(str(path), data, joint, origin) for joint, origin in pairs if not _same(joint.origin, origin)]
    for start, end, text in sorted(edits, reverse=True):
        data = data[:start] + text + data[end:]
    return data


def _same(before: Floats, after: Floats) -> bool:
    """Equal up to rounding: 1e-9 mm, and 1e-12 of a rotation matrix."""
    return bool(np.abs(after - before)[:3, 3].max() < 1e-9 and np.abs(after - before)[:3, :3].max() < 1e-12)


def _edit(file: str, data: bytes, joint: UrdfJoint, origin: Floats) -> tuple[int, int, bytes]:
    """Place (from, to) and new bytes of the start tag of a joint's `<origin>`, which is added where it has none."""
    xyz, rpy = origin_words(origin)
    words = f' xyz="{" ".join(xyz)}" rpy="{" ".join(rpy)}"'.encode()
    element = joint.element.first("origin")
    start = (element or joint.element).start
    tag = _TAG_END.match(data, start)
    if tag is None or not tag.group().startswith(b"<origin" if element else b"<joint"):
        raise InputError(Problem(file, joint.element.line, 0, "is not in an encoding like ASCII", "save it as UTF-8"))
    if element is None:
        return tag.end(), tag.end(), b"\n    <origin" + words + b"/>"
    return start, tag.end(), b"<origin" + words + _ORIGIN_ATTRIBUTE.sub(b"", tag.group()[len(b"<origin") :])


UR_LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_ROLLS = (0.0, 90.0, 0.0, 0.0, 90.0, -90.0)
"""Roll of each link in the one before, deg, of every robot of this maker; pitch and yaw are 0."""
_SAME_TURN_DEG = 5.0
"""A calibrated arm's axes and zeros are up to a degree from the data sheet; another robot's are a quarter turn away."""
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
    usual = [*_nominal_frames(nominal, file)[:-1], reading_axes(found).flange]
    axes, z = reading_axes(found), np.array([0.0, 0.0, 1.0])
    frames = [np.eye(4)]
    for frame, point, along in zip(usual, axes.points, axes.along, strict=True):
        frames.append(nearest_on_axis(frame, point, along, z))
    lines = ["kinematics:"]
    for name, before, frame in zip(UR_LINKS, frames, frames[1:], strict=False):
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
    joints = nominal.joint_map()
    if joints.n != len(UR_LINKS) or (joints.sign != 1.0).any():
        what = f"is no UR robot: it has {joints.n} joints, with readings counted {_senses(joints.sign)}"
        raise InputError(Problem(file, 0, 0, what, _CURE))
    chain = to_mdh(nominal.chain)
    assert isinstance(chain.table, LinkTable)
    behind = inverse_pose(nominal.chain.base) @ chain.frames(joints.model(np.zeros(joints.n)))[:-1]
    frames = [frame @ pose(np.eye(3), [0.0, 0.0, row.d]) for frame, row in zip(behind, chain.table.links, strict=True)]
    for name, roll, before, frame in zip(UR_LINKS, _ROLLS, [np.eye(4), *frames], frames, strict=False):
        apart = np.degrees(turned_by(pose_from_xyz_abc([0.0] * 3, [0.0, 0.0, roll]), inverse_pose(before) @ frame))
        if apart > _SAME_TURN_DEG:
            what = f"is no UR robot: {name} is turned by {apart:.0f}° from where the description package has it"
            raise InputError(Problem(file, 0, 0, what, _CURE))
    return frames


def _senses(sign: Floats) -> str:
    return "against the model" if (sign < 0.0).any() else "with the model"
