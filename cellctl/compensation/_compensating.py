"""Joints that take the identified robot to targets, by repeated passes of a method, or the reason why none do.

A controller computes with its nominal kinematics f; the robot does f*. It is sent to a pseudo-target T_s instead of the
target T_d, chosen so that f*(f⁻¹(T_s)) = T_d, or its joints are corrected directly: `METHODS`. f and f* differ by
millimetres over metres, and each pass shrinks the error by that ratio: three suffice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration import At, RobotModel
from cellctl.compensation._corrections import (
    METHODS,
    Method,
    NominalWithErrors,
    Pass,
    PredictedErrors,
    Predictor,
    WithoutZeros,
)
from cellctl.kinematics import Bools, Floats, InverseResult, SerialChain, inverse, pose_difference
from cellctl.kinematics.low_discrepancy import spread_over

OUT_OF_REACH = "the target is out of the robot's reach"

_SINGULAR = 0.02
"""Smallest singular value of the Jacobian, lengths in units of the reach, below which a posture is near a singularity:
an error of 1 mm on an arm of a metre then asks for 3° of some joint."""

RAD_PER_MM = 1e-3
"""Tolerance of the orientation, rad, for one of 1 mm: equal at a metre from the TCP."""

_ASTRAY = 4.0
"""A pass may correct a joint by so many times the limit of the result: near a singularity the first one overshoots."""

TOLERANCE_MM = 1e-6
"""Distance left at the end by default, mm; a thousandth of it in rad is the orientation left."""

MOST_PASSES = 20
"""Of a method that repeats until its tolerance, at the most."""

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
    return spread_over(q.min(axis=0) - _NEAR_RAD, q.max(axis=0) + _NEAR_RAD, 256, scramble=False)


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


@final
@dataclass(frozen=True, slots=True)
class Ends:
    """When the passes for a target end.

    tolerance_mm: at this distance (and `RAD_PER_MM` of it in rad); None: never. most: after so many passes. most_rad:
    the largest correction of a joint in the result.
    """

    tolerance_mm: float | None
    most: int
    most_rad: float


@final
class Passes:
    """All targets after the passes made so far.

    q (N, n), rad: commanded joints. left (N, 6), mm and rad: predicted shift and rotation vector to the target.
    history: `left` at the nominal joints and after each pass. reasons: why a target is not reached, or empty.
    """

    def __init__(
        self, sender: SerialChain, robot: Predictor, method: Method, targets: Floats, first: InverseResult
    ) -> None:
        self._sender, self._robot, self._method, self._targets, self._first = sender, robot, method, targets, first
        self._now = Pass(first.q.copy(), targets.copy(), first.converged)
        self.q = first.q.copy()
        self.left = pose_difference(targets, robot.pose(first.q + robot.zeros))
        self.history = [self.left.copy()]
        self.reasons = ["" if reached else OUT_OF_REACH for reached in first.converged.tolist()]

    def make(self, ends: Ends) -> None:
        """Make passes until every target is at its end."""
        open_ = self._first.converged & ~self._within(ends)
        for _ in range(ends.most):
            if not open_.any():
                break
            rows = np.flatnonzero(open_)
            open_[rows] = self._pass(rows, ends)
            open_ &= ~self._within(ends)
            self.history.append(self.left.copy())
        if ends.tolerance_mm is not None:
            for row in np.flatnonzero(open_).tolist():
                self.reasons[row] = self._rest(row, ends)
        change = self.q - self._first.q
        for row in np.flatnonzero(np.abs(change).max(axis=1, initial=0.0) > ends.most_rad).tolist():
            self.reasons[row] = self.reasons[row] or self._far(row, change[row], ends)

    def _pass(self, rows: np.ndarray[tuple[int, ...], np.dtype[np.intp]], ends: Ends) -> Bools:
        """One pass of the targets `rows`; which of them may have another. The nearest joints so far are kept."""
        step = self._method.correction(self._sender, self._robot, self._targets[rows], self._now.pick(rows))
        q, left = step.q - self._robot.zeros, pose_difference(self._targets[rows], self._robot.pose(step.q))
        change = q - self._first.q[rows]
        small = np.abs(change).max(axis=1) <= _ASTRAY * ends.most_rad
        good = np.asarray(step.reached & small)
        for place in np.flatnonzero(~good).tolist():
            row = int(rows[place])
            if step.reached[place]:
                self.reasons[row] = self._far(row, change[place], ends)
            else:
                self.reasons[row] = unreached_reason(self._sender, self._first.q[row], self._millimetres(row))
        self._now.q[rows[good]], self._now.pseudo[rows[good]] = step.q[good], step.pseudo[good]
        nearer = good & ((self._size(left) < self._size(self.left[rows])) | (ends.tolerance_mm is None))
        self.q[rows[nearer]], self.left[rows[nearer]] = q[nearer], left[nearer]
        return good

    def _within(self, ends: Ends) -> Bools:
        if ends.tolerance_mm is None:
            return np.zeros(len(self.left), bool)
        turned = angles(self.left) <= RAD_PER_MM * ends.tolerance_mm
        return np.asarray((distances(self.left) <= ends.tolerance_mm) & (turned | self._method.position_only))

    def _size(self, left: Floats) -> Floats:
        turned = 0.0 if self._method.position_only else angles(left) / RAD_PER_MM
        return np.asarray(distances(left) + turned)

    def _rest(self, row: int, ends: Ends) -> str:
        angle = 0.0 if self._method.position_only else float(angles(self.left[row]))
        return rest_reason(self._sender, self._first.q[row], self._millimetres(row), angle, ends.most)

    def _far(self, row: int, change: Floats, ends: Ends) -> str:
        return branch_reason(self._sender, self._first.q[row], change, ends.most_rad)

    def _millimetres(self, row: int) -> float:
        return float(distances(self.left[row]))


def distances(left: Floats) -> Floats:
    """Length (...) of the shifts of `left` (..., 6), mm."""
    return np.asarray(np.linalg.norm(left[..., :3], axis=-1))


def angles(left: Floats) -> Floats:
    """Length (...) of the rotation vectors of `left` (..., 6), rad."""
    return np.asarray(np.linalg.norm(left[..., 3:], axis=-1))


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
