"""Joints that take the identified robot to targets, by repeated passes of a method.

A controller computes with its nominal kinematics f; the robot does f*. It is sent to a pseudo-target T_s instead of the
target T_d, chosen so that f*(f⁻¹(T_s)) = T_d, or its joints are corrected directly: `METHODS`. f and f* differ by
millimetres over metres, and each pass shrinks the error by that ratio: three suffice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import qmc

from cellctl.calibration import At, RobotModel
from cellctl.compensation.corrections import METHODS, Method
from cellctl.compensation.passes import Ends, Passes, angles, distances
from cellctl.compensation.predictors import NominalWithErrors, PredictedErrors, WithoutZeros
from cellctl.kinematics import Bools, Floats, SerialChain, inverse

TOLERANCE_MM = 1e-6
"""Distance left at the end by default, mm; a thousandth of it in rad is the orientation left."""

MOST_PASSES = 20

_NEAR_RAD = np.deg2rad(20.0)

MOST_CORRECTION_DEG = 15.0
"""Joints are corrected by tenths of a degree. One that is this far from its nominal angle is on another branch of the
inverse, or the posture is at a singularity. What a cell allows is less."""


@final
@dataclass(frozen=True, eq=False)
class Compensated:
    """Joints for N targets: those of a nominal controller, and those that the identified robot needs.

    nominal_q, compensated_q (N, n): model angles, rad. error_mm, error_deg (passes + 1, N): distance and angle of the
    identified robot's TCP from the target at the nominal joints and after each pass; a target that is reached stays as
    it was. The angle is NaN where an error map predicts: it has positions only. converged (N,): the target is reached.
    reasons (N,): why not, empty where it is; the other arrays then hold the nearest result. position_only: the
    orientation is not compensated.
    """

    nominal_q: Floats
    compensated_q: Floats
    error_mm: Floats
    error_deg: Floats
    converged: Bools
    reasons: tuple[str, ...]
    position_only: bool = False

    @property
    def passes(self) -> int:
        """The number of passes made."""
        return len(self.error_mm) - 1

    @property
    def predicted_before_mm(self) -> Floats:
        """Predicted distance from the target (N,), mm, at the nominal joints."""
        return np.asarray(self.error_mm[0])

    @property
    def predicted_after_mm(self) -> Floats:
        """Predicted distance from the target (N,), mm, at the compensated joints."""
        return np.asarray(self.error_mm[-1])


def compensate(
    nominal: SerialChain,
    identified: RobotModel | PredictedErrors,
    targets: ArrayLike,
    start: ArrayLike,
    *,
    method: str = "pseudo-target",
    tolerance_mm: float = TOLERANCE_MM,
    passes: int | None = None,
    region: At | None = None,
    correction_deg: float = MOST_CORRECTION_DEG,
) -> Compensated:
    """Joints that take the identified robot to `targets` (N, 4, 4), mm, found from postures near `start` (N, n), rad.

    nominal: the controller's chain; its deviations are ignored. identified: the robot, tool deflection included, its
    base and tool counted from the same poses as the nominal's; or, for `cyclic-search`, predicted position errors
    (`errors` of an error map). Targets are in the frame in which the model was identified. For a model from touches
    that is the frame of its sphere centres: the base's heading and height (θ1, d1) are correlated with the centres, so
    model and centres belong together, and targets near a sphere must be built on the centre that came with the model.

    method: one of `METHODS`. passes: None repeats until `tolerance_mm` (and a thousandth of it in rad) is left; a
    number makes so many passes, as the methods are published, and leaves what they leave. region: M postures, spread
    over the region for which write-back chooses its parameters; default: angles up to 20° around the nominal joints.
    correction_deg: a target for which a joint would be corrected by more is not reached. One target does not change the
    result of another. Joint limits are the caller's, as in `inverse`. Raises ValueError for an unknown method or shapes
    that do not fit.
    """
    chosen, controller = _method(method, identified), nominal.with_parameters({})
    wanted, begin = _checked(targets, start, controller)
    first = inverse(controller, wanted, begin)
    ends = Ends(tolerance_mm, MOST_PASSES, np.deg2rad(correction_deg))
    if passes is not None:
        ends = replace(ends, tolerance_mm=None, most=passes)
    if callable(identified):
        made = Passes(controller, NominalWithErrors(controller, identified), chosen, wanted, first)
    else:
        _check_frames(controller, identified)
        sender, robot = controller, WithoutZeros.of(identified, apart=chosen.zeros_apart)
        if chosen.write_back:
            over = _around(first.q) if region is None else region
            sender = chosen.write_back(controller, identified, over)
            ends = replace(ends, tolerance_mm=None, most=1)
        made = Passes(sender, robot, chosen, wanted, first)
    made.make(ends)
    history = np.stack(made.history)
    return Compensated(
        nominal_q=first.q,
        compensated_q=made.q,
        error_mm=distances(history),
        error_deg=np.rad2deg(angles(history)) * (np.nan if callable(identified) else 1.0),
        converged=np.array([not reason for reason in made.reasons], bool),
        reasons=tuple(made.reasons),
        position_only=chosen.position_only,
    )


def _around(q: Floats) -> Floats:
    """256 postures (256, n) spread over a box around q (N, n), rad, the same each time."""
    low, high = q.min(axis=0) - _NEAR_RAD, q.max(axis=0) + _NEAR_RAD
    return np.asarray(low + qmc.Sobol(len(low), scramble=False).random(256) * (high - low))


def _method(name: str, identified: RobotModel | PredictedErrors) -> Method:
    if name not in METHODS:
        raise ValueError(f"compensation method '{name}' is not known (known: {', '.join(METHODS)})")
    if callable(identified) and not METHODS[name].position_only:
        takes = ", ".join(each for each, method in METHODS.items() if method.position_only)
        raise ValueError(f"compensation method '{name}' needs an identified model; position errors are for {takes}")
    return METHODS[name]


def _checked(targets: ArrayLike, start: ArrayLike, controller: SerialChain) -> tuple[Floats, Floats]:
    wanted, begin = np.array(targets, float), np.array(start, float)
    if wanted.ndim != 3 or wanted.shape[1:] != (4, 4):
        raise ValueError(f"targets of shape {wanted.shape}, not (N, 4, 4)")
    if begin.shape != (len(wanted), controller.n):
        raise ValueError(f"postures of shape {begin.shape} for {len(wanted)} targets and {controller.n} joints")
    return wanted, begin


def _check_frames(controller: SerialChain, identified: RobotModel) -> None:
    if identified.n != controller.n:
        raise ValueError(f"the identified robot has {identified.n} joints, the nominal one {controller.n}")
    frames = ((controller.base, identified.chain.base), (controller.tool, identified.chain.tool))
    if not all(np.allclose(ours, theirs, atol=1e-9) for ours, theirs in frames):
        raise ValueError("base or tool of the nominal and the identified robot count from different poses")
