"""Identified parameters in the controller, in the form that it takes."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from cellctl.calibration import RobotModel
from cellctl.kinematics import Floats, SerialChain, rotation_vector

_POSTURES, _STEPS = 256, 4


def with_geometry(controller: SerialChain, identified: RobotModel) -> SerialChain:
    """The controller's chain with all identified parameters of links, base and tool, as a UR takes them.

    Effects (compliance, tool deflection, …) remain outside.
    """
    return controller.with_parameters(identified.chain.deviations) if identified.chain.deviations.size else controller


def with_zeros_and_frames(controller: SerialChain, identified: RobotModel, low: Floats, high: Floats) -> SerialChain:
    """The controller's chain with other joint zeros, base and tool, as a KUKA takes them; the links stay nominal.

    The values are those that come nearest to the identified robot over the postures `low` … `high` (n,), rad: least
    squares over 256 postures, orientation weighted by half the reach; the shortest vector where they are ambiguous.
    They differ from the identified θ, base and tool where these compensate for links.
    """
    q = low + qmc.Sobol(len(low), scramble=False).random(_POSTURES) * (high - low)
    goal, names = identified.pose(q), controller.parameters
    free = np.array([name.startswith(("theta", "base_", "tool_")) for name in names])
    arm = max(controller.reach_mm / 2.0, 1.0)
    unit = np.where(controller.parameter_turns, 1.0 / arm, 1.0)[free]
    values = np.zeros(len(names))
    for _ in range(_STEPS):
        chain = controller.with_parameters(values)
        columns = chain.parameter_jacobian(q)[:, :, free] * unit
        columns[:, 3:] *= arm
        left = np.linalg.lstsq(columns.reshape(-1, len(unit)), _difference(goal, chain.forward(q), arm).ravel())[0]
        values[free] += left * unit
    return controller.with_parameters(values)


def _difference(goal: Floats, actual: Floats, arm: float) -> Floats:
    """Shift and rotation (N, 6) from actual to goal, both in mm."""
    turn = rotation_vector(np.matmul(goal[:, :3, :3], np.swapaxes(actual[:, :3, :3], -1, -2)))
    return np.concatenate([goal[:, :3, 3] - actual[:, :3, 3], arm * turn], axis=-1)
