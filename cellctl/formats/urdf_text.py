"""URDF out: a link and a joint for each axis, in the controller's sense. A URDF joint is the reading in radians."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

from cellctl.formats.description import JointSaid, RobotDescription
from cellctl.formats.robot_text import DECIMALS_MM, number
from cellctl.formats.urdf import BASE_LINK, FLANGE_LINK

if TYPE_CHECKING:
    from cellctl.kinematics import Floats

DECIMALS_RAD = 15


def urdf_text(robot: RobotDescription) -> str:
    """The robot as URDF: from `world` (where the base is not its origin) over `base_link`, `link_1` … `link_n` and the
    flange `tool0` to `tcp` (where there is a tool). Joints without limits become continuous. No masses, no shapes.
    """
    import numpy as np

    from cellctl.kinematics import inverse_pose

    chain = robot.chain.with_base(np.eye(4))
    frames = chain.frames(robot.joint_map().model(np.zeros(chain.n)))
    steps = [
        frames[0],
        *(inverse_pose(before) @ behind for before, behind in itertools.pairwise(frames)),
    ]
    links = [BASE_LINK, *(f"link_{index}" for index in range(1, chain.n + 1)), FLANGE_LINK]
    joints = [
        _joint(joint.name or f"joint_{index + 1}", _kind(joint), links[index : index + 2], step, _moves(joint))
        for index, (joint, step) in enumerate(zip(robot.joints, steps[:-1], strict=True))
    ]
    joints.append(_joint("-".join(links[-2:]), "fixed", links[-2:], steps[-1]))
    if not np.array_equal(robot.chain.base, np.eye(4)):
        links.insert(0, "world")
        joints.insert(0, _joint("-".join(links[:2]), "fixed", links[:2], robot.chain.base))
    if not np.array_equal(robot.chain.tool, np.eye(4)):
        links.append("tcp")
        joints.append(_joint("-".join(links[-2:]), "fixed", links[-2:], robot.chain.tool))
    body = [*(f'  <link name="{link}"/>' for link in links), *joints]
    head = ['<?xml version="1.0" encoding="UTF-8"?>', f"<robot name={quoteattr(robot.name)}>"]
    return "".join(f"{line}\n" for line in [*head, *body, "</robot>"])


def origin_words(step: Floats) -> tuple[list[str], list[str]]:
    """A pose (4, 4), mm, as an `<origin>` has it: x, y, z in m; roll, pitch, yaw (R = Rz Ry Rx) in rad."""
    from cellctl.kinematics import abc_from_rotation

    xyz = [_metres(value) for value in step[:3, 3].tolist()]
    return xyz, [_radians(value) for value in reversed(abc_from_rotation(step[:3, :3]).tolist())]


def _joint(name: str, kind: str, links: list[str], step: Floats, more: tuple[str, ...] = ()) -> str:
    xyz, rpy = origin_words(step)
    return "\n".join(
        [
            f'  <joint name={quoteattr(name)} type="{kind}">',
            f'    <parent link="{links[0]}"/>',
            f'    <child link="{links[1]}"/>',
            f'    <origin xyz="{" ".join(xyz)}" rpy="{" ".join(rpy)}"/>',
            *(f"    {line}" for line in more),
            "  </joint>",
        ]
    )


def _kind(joint: JointSaid) -> str:
    return "continuous" if joint.min is None or joint.max is None else "revolute"


def _moves(joint: JointSaid) -> tuple[str, ...]:
    """The axis, in the reading's sense, and limits. The effort is unknown: 0."""
    axis = f'<axis xyz="0 0 {joint.sign}"/>'
    ends = (
        ""
        if joint.min is None or joint.max is None
        else f'lower="{_radians(joint.min)}" upper="{_radians(joint.max)}" '
    )
    if not ends and joint.max_speed is None:
        return (axis,)
    return (axis, f'<limit {ends}effort="0" velocity="{_radians(joint.max_speed or 0.0)}"/>')


def _metres(value_mm: float) -> str:
    return number(float(number(value_mm, DECIMALS_MM)) / 1000.0, DECIMALS_MM + 3)


def _radians(degrees: float) -> str:
    return number(math.radians(degrees), DECIMALS_RAD)
