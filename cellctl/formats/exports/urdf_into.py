"""Calibrated joint origins written into the user's own URDF; all its other bytes stay.

Meshes, inertias and collision shapes are given in the link frames. So each link frame moves only as far as its joint's
axis demands: the least turn and shift. What remains at the tip goes into the fixed joint behind the last turning one.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from cellctl.files import InputError, Problem
from cellctl.formats.description import RobotDescription
from cellctl.formats.exports.axes import ReadingAxes, nearest_on_axis, reading_axes, turned_by
from cellctl.formats.urdf import UrdfChain, UrdfJoint, load_chain
from cellctl.formats.urdf_text import origin_words

if TYPE_CHECKING:
    from cellctl.kinematics import Floats

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
    import numpy as np

    from cellctl.kinematics import inverse_pose

    chain = load_chain(path, tip)
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
    import numpy as np

    return list(itertools.accumulate((joint.origin for joint in joints), np.matmul))


def _origins(joints: tuple[UrdfJoint, ...], wished: list[Floats], goal: ReadingAxes) -> tuple[list[Floats], Floats]:
    """Each joint's new origin (4, 4), and the pose of the last turning link's wished frame in its frame."""
    import numpy as np

    from cellctl.kinematics import inverse_pose

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
    import numpy as np

    from cellctl.kinematics import pose

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
    import numpy as np

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
    import numpy as np

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
