"""A robot's joint axes in its base frame, and the frame on an axis that is nearest to a given one.

A form that gives each link a frame on its joint's axis leaves two choices open: where along the axis, and how turned
about it. The nearest to the nominal frame keeps every number near its nominal value, also where axes are almost
parallel: their common perpendicular, which a DH table needs, may be hundreds of metres away.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

if TYPE_CHECKING:
    from cellctl.formats.description import RobotDescription
    from cellctl.kinematics import Floats


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
    import numpy as np

    joints = robot.joint_map()
    frames = robot.chain.with_base(np.eye(4)).frames(joints.model(np.zeros(joints.n)))
    return ReadingAxes(frames[:-1, :3, 3], frames[:-1, :3, 2] * joints.sign[:, None], frames[-1])


def nearest_on_axis(frame: Floats, point: Floats, along: Floats, axis: Floats) -> Floats:
    """The pose (4, 4) nearest to `frame` that lies on the line through `point` along `along` (unit vector).

    Its origin is on the line, and its direction `axis` (in its own frame, unit vector) is `along`: the least turn and
    the least shift that do so. Raises ValueError where `axis` points against `along`.
    """
    import numpy as np

    from cellctl.kinematics import pose

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
    import numpy as np

    from cellctl.kinematics import rotation_vector

    return float(np.linalg.norm(rotation_vector(frame[:3, :3].T @ other[:3, :3])))
