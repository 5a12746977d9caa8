"""Joint zeros, base and tool alone that come nearest to a model: what a controller takes without an option."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from cellctl.formats.exports.left_out import Cost, measured_postures
from cellctl.formats.exports.nearest import nearest_chain

if TYPE_CHECKING:
    from cellctl.formats.model import ModelFile
    from cellctl.kinematics import Floats


@final
@dataclass(frozen=True, eq=False)
class JointZeros:
    """offsets (n,), deg: the controller's readings at the same posture must grow by these.

    base, tool (4, 4), mm: in the measuring frame, and in the flange frame, that go with them. before: distance from the
    model where base and tool alone are set; after: with the offsets. The first and the last offset are 0: the base's
    heading and the tool's turn about the last axis hold them.
    """

    offsets: Floats
    base: Floats
    tool: Floats
    before: Cost
    after: Cost


def joint_zeros(model: ModelFile) -> JointZeros:
    """Least squares over the model's measured postures: position, and orientation at a short lever.

    A joint's zero is found with all else that the controller cannot take (lengths, angles of axes, effects) held at the
    robot file's values; so it is not the parameter of the model, but the offset that leaves the smallest error.
    """
    import numpy as np

    from cellctl.formats.table_making import nominal_chain

    identified, joints = model.robot_model(), model.robot.joint_map()
    at = measured_postures(model)
    q, goal = at.q, identified.pose(at)
    start = nominal_chain(model).with_base(identified.chain.base_now).with_tool(identified.chain.tool_now)
    none, inner = np.zeros(joints.n, bool), np.ones(joints.n, bool)
    inner[[0, -1]] = False
    held, _ = nearest_chain(start, q, goal, none)
    best, turned = nearest_chain(start, q, goal, inner)
    offsets = joints.sign * np.rad2deg(turned) + 0.0
    return JointZeros(offsets, best.base_now, best.tool_now, Cost.of(held, q, goal), Cost.of(best, q + turned, goal))
