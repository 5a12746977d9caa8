"""Identified parameters in the controller, in the form that it takes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from cellctl.calibration import RobotModel
from cellctl.kinematics import Bools, Floats, SerialChain, rotation_vector

LEVER_MM = 10.0
"""Distance from the TCP at which a difference in orientation counts as one in position, as in the exported offsets."""

_STEPS = 5
_NEGLIGIBLE = 1e-5
"""Combinations of parameters whose effect is this share of the strongest one's stay as they are."""


def with_geometry(controller: SerialChain, identified: RobotModel, postures: ArrayLike) -> SerialChain:
    """The controller's chain with other links, base and tool, as a UR takes them: nearest to the identified robot.

    postures (M, n): model angles, rad, over which it is nearest, by least squares; orientation counts by `LEVER_MM`.
    Without effects these are the identified parameters. With effects (compliance, deflection, …) they take over
    what they can of these; what is left cannot be written.
    """
    every = np.ones(len(controller.parameters), bool)
    known = identified.chain.deviations
    return _nearest(controller, identified, postures, every, known if known.size else np.zeros(every.size))


def with_zeros_and_frames(controller: SerialChain, identified: RobotModel, postures: ArrayLike) -> SerialChain:
    """The controller's chain with other joint zeros, base and tool, as a KUKA takes them; the links stay nominal.

    As `with_geometry`. The values differ from the identified θ, base and tool, which compensate for links.
    """
    names = controller.parameters
    free = np.array([name.startswith(("theta", "base_", "tool_")) for name in names])
    return _nearest(controller, identified, postures, free, np.zeros(len(names)))


def spread(low: ArrayLike, high: ArrayLike) -> Floats:
    """256 postures (256, n) spread over the box `low` … `high` (n,), the same each time."""
    lower, upper = np.asarray(low, float), np.asarray(high, float)
    return np.asarray(lower + qmc.Sobol(len(lower), scramble=False).random(256) * (upper - lower))


def _nearest(
    controller: SerialChain, identified: RobotModel, postures: ArrayLike, free: Bools, start: Floats
) -> SerialChain:
    """The chain whose `free` parameters (P,) bring it nearest to the identified robot, by Gauss–Newton from `start`."""
    q = np.asarray(postures, float)
    goal, reach = identified.pose(q), max(controller.reach_mm, 1.0)
    unit = np.where(controller.parameter_turns, 1.0 / reach, 1.0)[free]
    values = start.copy()
    for _ in range(_STEPS):
        chain = controller.with_parameters(values)
        columns = chain.parameter_jacobian(q)[:, :, free] * unit
        columns[:, 3:] *= LEVER_MM
        left = _difference(goal, chain.forward(q)).ravel()
        values[free] += unit * np.linalg.lstsq(columns.reshape(-1, len(unit)), left, rcond=_NEGLIGIBLE)[0]
    return controller.with_parameters(values)


def _difference(goal: Floats, actual: Floats) -> Floats:
    """Shift and rotation (N, 6) from actual to goal, both in mm, the rotation at its lever."""
    turn = rotation_vector(np.matmul(goal[:, :3, :3], np.swapaxes(actual[:, :3, :3], -1, -2)))
    return np.concatenate([goal[:, :3, 3] - actual[:, :3, 3], LEVER_MM * turn], axis=-1)
