"""Joint zeros, base and tool alone that come nearest to a model: what a controller takes without an option."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, final

from cellctl.formats.exports.left_out import Cost, measured_postures

if TYPE_CHECKING:
    from cellctl.formats.model import ModelFile
    from cellctl.kinematics import Bools, Floats, SerialChain

LEVER_MM = 10.0
"""Distance from the TCP at which a difference in orientation counts as one in position."""
_PASSES = 12
_DONE = 1e-10
_FRAMES = ("base_", "tool_")


@final
@dataclass(frozen=True, eq=False)
class JointZeros:
    """offsets (n,), deg: the controller's readings at the same posture must grow by these.

    base, tool (4, 4), mm: in the measuring frame, and in the flange frame, that go with them. before: distance from the
    model where base and tool alone are set; after: with the offsets. The first and the last offset are 0: base and tool
    hold them, and no measurement can tell them apart.
    """

    offsets: Floats
    base: Floats
    tool: Floats
    before: Cost
    after: Cost


def joint_zeros(model: ModelFile) -> JointZeros:
    """Least squares over the model's measured postures: position, and orientation at a lever of LEVER_MM.

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
    held, _ = _nearest(start, q, goal, none)
    best, turned = _nearest(start, q, goal, inner)
    offsets = joints.sign * np.rad2deg(turned) + 0.0
    return JointZeros(offsets, best.base_now, best.tool_now, _cost(held, q, goal), _cost(best, q + turned, goal))


def _cost(chain: SerialChain, q: Floats, goal: Floats) -> Cost:
    return Cost.of((chain.forward(q) - goal)[:, :3, 3])


def _nearest(chain: SerialChain, q: Floats, goal: Floats, free: Bools) -> tuple[SerialChain, Floats]:
    """The chain with base and tool, and the turns of the `free` joints (n,), rad, nearest to poses `goal` at q."""
    import numpy as np

    from cellctl.kinematics import rotation_vector

    frames = [index for index, name in enumerate(chain.parameters) if name.startswith(_FRAMES)]
    values, turned = np.zeros(len(chain.parameters)), np.zeros(chain.n)
    for _ in range(_PASSES):
        found, columns = chain.forward_and_jacobian(q + turned)
        spins = rotation_vector(goal[:, :3, :3] @ np.swapaxes(found[:, :3, :3], 1, 2))
        apart = np.hstack([goal[:, :3, 3] - found[:, :3, 3], LEVER_MM * spins])
        both = np.concatenate([chain.parameter_jacobian(q + turned)[..., frames], columns[..., free]], axis=-1)
        both[:, 3:] *= LEVER_MM
        step = np.linalg.lstsq(both.reshape(apart.size, -1), apart.ravel(), rcond=1e-10)[0]
        values[frames] += step[: len(frames)]
        turned[free] += step[len(frames) :]
        chain = chain.with_parameters(values)
        if np.abs(step).max() < _DONE:
            break
    return chain, turned
