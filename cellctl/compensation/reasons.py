"""Why a target has no compensated joints, in words."""

from __future__ import annotations

import numpy as np

from cellctl.kinematics import Floats, SerialChain

OUT_OF_REACH = "the target is out of the robot's reach"

_SINGULAR = 0.02
"""Smallest singular value of the Jacobian, lengths in units of the reach, below which a posture is near a singularity:
an error of 1 mm on an arm of a metre then asks for 3° of some joint."""


def branch_reason(chain: SerialChain, q: Floats, correction: Floats, most_rad: float) -> str:
    """For a correction (n,), rad, of the posture q (n,) that is larger than `most_rad`."""
    joint = int(np.argmax(np.abs(correction)))
    size, most = np.rad2deg([correction[joint], most_rad])
    what = f"A{joint + 1} would be corrected by {size:+.1f}°, more than {most:g}°"
    return what + _singularity(chain, q)


def unreached_reason(chain: SerialChain, q: Floats, left_mm: float) -> str:
    """For a target near the posture q (n,) whose pseudo-target the controller cannot reach."""
    return f"the corrected target is out of the controller's reach: {left_mm:.3g} mm remain" + _singularity(chain, q)


def rest_reason(chain: SerialChain, q: Floats, left_mm: float, left_rad: float, passes: int) -> str:
    """For a target near the posture q (n,) that is not reached within tolerance after so many passes."""
    left = f"{left_mm:.3g} mm and {np.rad2deg(left_rad):.3g}° remain after {passes} passes"
    return f"the passes do not converge: {left}" + _singularity(chain, q)


def _singularity(chain: SerialChain, q: Floats) -> str:
    """The joints that hardly move the TCP when turned together; empty away from singularities."""
    jacobian = chain.tool_jacobian(q) / np.array([max(chain.reach_mm, 1.0)] * 3 + [1.0] * 3)[:, None]
    _, sizes, rows = np.linalg.svd(jacobian)
    last = min(len(sizes), 6) - 1
    if sizes[last] > _SINGULAR:
        return ""
    share = np.abs(rows[last])
    names = ", ".join(f"A{joint + 1}" for joint in np.flatnonzero(share > 0.3 * share.max()))
    return f"; the posture is near a singularity ({names} turned together hardly move the tool)"
