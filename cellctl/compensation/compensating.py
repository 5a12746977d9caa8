"""Joints that take the identified robot to targets, by repeated passes of a method.

A controller computes with its nominal kinematics f; the robot does f*. It is sent to a pseudo-target T_s instead of the
target T_d, chosen so that f*(f⁻¹(T_s)) = T_d, or its joints are corrected directly: `METHODS`. f and f* differ by
millimetres over metres, and each pass shrinks the error by that ratio: two or three suffice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration import RobotModel
from cellctl.compensation.corrections import METHODS, Pass, WithoutZeros, difference
from cellctl.kinematics import Bools, Floats, SerialChain, inverse

_TOLERANCE_RAD = 1e-7
"""Orientation left at the end: 0.1 µm on a tool of a metre."""


@final
@dataclass(frozen=True, eq=False)
class Compensated:
    """Joints for N targets: those of a nominal controller, and those that the identified robot needs.

    nominal_q, compensated_q (N, n): model angles, rad. predicted_before_mm, predicted_after_mm (N,): distance of the
    identified robot's TCP from the target at these, mm. passes: their count. converged (N,): the target is reached
    within tolerance; otherwise the other arrays hold the nearest result.
    """

    nominal_q: Floats
    compensated_q: Floats
    predicted_before_mm: Floats
    predicted_after_mm: Floats
    passes: int
    converged: Bools


def compensate(
    nominal: SerialChain,
    identified: RobotModel,
    targets: ArrayLike,
    start: ArrayLike,
    *,
    method: str = "pseudo-target",
    tolerance_mm: float = 1e-4,
    passes: int = 20,
) -> Compensated:
    """Joints that take the identified robot to `targets` (N, 4, 4), mm, found from postures near `start` (N, n), rad.

    nominal: the controller's chain; its deviations are ignored. identified: the robot, tool deflection included, its
    base and tool counted from the same poses as the nominal's. Targets are in the frame in which the model was
    identified. For a model from touches that is the frame of its sphere centres: the base's heading and height (θ1, d1)
    are correlated with the centres, so model and centres belong together, and targets near a sphere must be built on
    the centre that came with the model.

    method: one of `METHODS`. passes: the most that are made; 1 gives the methods that are published without iteration.
    Joint limits are the caller's, as in `inverse`. Raises ValueError for an unknown method or shapes that do not fit.
    """
    if method not in METHODS:
        raise ValueError(f"compensation method '{method}' is not known (known: {', '.join(METHODS)})")
    chosen, controller = METHODS[method], nominal.with_parameters({})
    wanted, begin = _checked(targets, start, controller, identified)
    robot = WithoutZeros.of(identified, apart=chosen.zeros_apart)
    first = inverse(controller, wanted, begin)
    now, q, made = Pass(first.q, wanted.copy(), first.converged), first.q, 0
    rest = before = difference(wanted, identified.pose(q))
    while made < passes and not _within(rest[now.reached], tolerance_mm).all():
        now = chosen.correction(controller, robot, wanted, now)
        q = now.q - robot.zeros
        rest = difference(wanted, identified.pose(q))
        made += 1
    return Compensated(
        nominal_q=first.q,
        compensated_q=q,
        predicted_before_mm=_distance(before),
        predicted_after_mm=_distance(rest),
        passes=made,
        converged=np.asarray(now.reached & _within(rest, tolerance_mm)),
    )


def _checked(
    targets: ArrayLike, start: ArrayLike, controller: SerialChain, identified: RobotModel
) -> tuple[Floats, Floats]:
    wanted, begin = np.array(targets, float), np.array(start, float)
    if wanted.ndim != 3 or wanted.shape[1:] != (4, 4):
        raise ValueError(f"targets of shape {wanted.shape}, not (N, 4, 4)")
    if identified.n != controller.n:
        raise ValueError(f"the identified robot has {identified.n} joints, the nominal one {controller.n}")
    if begin.shape != (len(wanted), controller.n):
        raise ValueError(f"postures of shape {begin.shape} for {len(wanted)} targets and {controller.n} joints")
    frames = ((controller.base, identified.chain.base), (controller.tool, identified.chain.tool))
    if not all(np.allclose(ours, theirs, atol=1e-9) for ours, theirs in frames):
        raise ValueError("base or tool of the nominal and the identified robot count from different poses")
    return wanted, begin


def _distance(difference: Floats) -> Floats:
    return np.asarray(np.linalg.norm(difference[:, :3], axis=-1))


def _within(difference: Floats, tolerance_mm: float) -> Bools:
    turned = np.linalg.norm(difference[:, 3:], axis=-1)
    return np.asarray((_distance(difference) <= tolerance_mm) & (turned <= _TOLERANCE_RAD))
