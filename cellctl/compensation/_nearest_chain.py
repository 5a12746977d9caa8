"""The chain nearest to an identified robot, effects included, with the parameters that a controller or form takes."""

from __future__ import annotations

import numpy as np

from cellctl.calibration import At, Postures, RobotModel
from cellctl.kinematics import Bools, Floats, SerialChain, pose_difference

LEVER_MM = 10.0
"""Distance from the TCP at which a difference in orientation counts as one in position."""

_PASSES = 12
_DONE = 1e-10
_NEGLIGIBLE = 1e-5
"""Combinations of parameters whose effect is this share of the strongest one's stay as they are."""

_FRAMES = ("base_", "tool_")


def with_geometry(controller: SerialChain, identified: RobotModel, postures: At) -> SerialChain:
    """The controller's chain with other links, base and tool, as a UR or a planner takes them.

    It is nearest to the identified robot over `postures`, M of them with their conditions, or model angles (M, n), rad,
    by least squares; orientation counts by `LEVER_MM`. Without effects these are the identified parameters. With
    effects (compliance, harmonics, …) they take over what they can of these.

    What is left then counts as noise, and each parameter's change from the identified one has a prior of 1 mm (1 σ), at
    the reach for an angle. So parameters that `postures` hardly determine (near-parallel axes) keep their size.
    """
    known = identified.chain.deviations
    every = np.ones(len(controller.parameters), bool)
    return _nearest(controller, identified, postures, every, known, prior_mm=1.0)


def with_zeros_and_frames(controller: SerialChain, identified: RobotModel, postures: At) -> SerialChain:
    """The controller's chain with other joint zeros, base and tool, as a KUKA takes them; its links stay.

    As `with_geometry`, without prior. θ1 and θn stay 0: the base's heading and the tool's turn about the last axis hold
    them. The values differ from the identified θ, base and tool, which compensate for links.
    """
    inner = tuple(f"theta{joint}" for joint in range(2, controller.n))
    free = np.array([name in inner or name.startswith(_FRAMES) for name in controller.parameters])
    return _nearest(controller, identified, postures, free, controller.deviations)


def with_frames(controller: SerialChain, identified: RobotModel, postures: At) -> SerialChain:
    """The controller's chain with other base and tool: nominal registered. As `with_zeros_and_frames`."""
    free = np.array([name.startswith(_FRAMES) for name in controller.parameters])
    return _nearest(controller, identified, postures, free, controller.deviations)


def zeros_of(chain: SerialChain) -> Floats:
    """Deviations of the joint zeros θ1 … θn (n,), rad, along the model angles."""
    values = dict(zip(chain.parameters, chain.deviations.tolist(), strict=False))
    return np.array([values.get(f"theta{joint}", 0.0) for joint in range(1, chain.n + 1)])


def _nearest(
    controller: SerialChain,
    identified: RobotModel,
    postures: At,
    free: Bools,
    start: Floats,
    prior_mm: float = np.inf,
) -> SerialChain:
    """The chain whose `free` parameters (P,) bring it nearest to the identified robot, by Gauss–Newton from `start`."""
    q, goal = Postures.of(postures).q, identified.pose(postures)
    unit = np.where(controller.parameter_turns, 1.0 / max(controller.reach_mm, 1.0), 1.0)[free]
    begin = start if start.size else np.zeros(len(free))
    values = begin.copy()
    for _ in range(_PASSES):
        chain = controller.with_parameters(values)
        columns = chain.parameter_jacobian(q)[:, :, free] * unit
        columns[:, 3:] *= LEVER_MM
        left = pose_difference(goal, chain.forward(q))
        left[:, 3:] *= LEVER_MM
        hold = float(np.sqrt(np.mean(left[:, :3] ** 2))) / prior_mm  # σ of the rows / σ of the prior, both mm
        rows = np.concatenate([columns.reshape(-1, len(unit)), hold * np.eye(len(unit))])
        wanted = np.concatenate([left.ravel(), hold * ((begin - values)[free] / unit)])
        step = np.linalg.lstsq(rows, wanted, rcond=_NEGLIGIBLE)[0]
        values[free] += unit * step
        if np.abs(step).max() < _DONE:
            break
    return controller.with_parameters(values)
