"""The base, the tool and, where free, the joint zeros with which a chain comes nearest to given poses."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cellctl.kinematics import Bools, Floats, SerialChain

LEVER_MM = 10.0
"""Distance from the TCP at which a difference in orientation counts as one in position."""
_PASSES = 12
_DONE = 1e-10
_FRAMES = ("base_", "tool_")


def nearest_chain(chain: SerialChain, q: Floats, goal: Floats, free: Bools) -> tuple[SerialChain, Floats]:
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
