"""Base and tool frame of a robot from circles, by turning A1, A2, A5 and A6 alone (KRG section 2.3), with covariance.

**Circle.** Centre c, unit direction z of the axis, radius r. Two residuals for each point x: its height over the
plane, h = z·(x − c), and its radial distance ρ − r, ρ = ‖(x − c) − h z‖. A point's covariance C turns into that of its
residuals along z and along the radial unit vector e: [zᵀCz zᵀCe; eᵀCz eᵀCe]; what points have in common couples them
all. Generalised least squares by Gauss–Newton, in 6 unknowns: c has three, z two (tilts about axes across it), r one.
It starts from a closed form: plane by SVD, and in it Kåsa's linear equations 2 c·x + (r² − c·c) = x·x (1976), which
favour small radii on short arcs: only a start.

A short arc knows centre and radius only together: their covariance, not their σ, goes on. `gain` is the derivative of
the result by the points, so that frames made of several circles of the same points propagate what they share.

{B}: z on A1's axis, x along the common perpendicular of A1 and A2, origin on A1. {T}: x on A6's axis, z perpendicular
to A5 and A6, origin at the reflector. Both are geometric statements about the true robot; set against the nominal
chain's own axes they tell where the instrument is and where the reflector is on the flange.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import chi2_isf, chi2_ppf, chi2_sf
from cellctl.kinematics import Bools, Floats, SerialChain, inverse_pose, pose, pose_difference
from cellctl.metrology.measured_points import Points, whitened
from cellctl.metrology.measured_pose import MeasuredPose

STEPS = 30
OUTLYING = 1e-3
"""Probability that a circle without outliers has a point flagged as one."""
LEAST_POINTS = 5
"""Points below which no outlier is looked for; a circle itself needs 3."""
LEAST_ARC = 1e-3
"""Smallest sagitta of the points' arc as a share of its chord."""


class NoCircle(ValueError):
    """Points do not determine a circle; the text says why and what to do."""


@final
@dataclass(frozen=True, eq=False)
class Circle:
    """A fitted circle, mm. centre (3,); direction (3,): unit vector of its axis, right-handed to the turn; radius.

    covariance (7, 7): of centre, direction, radius; it has rank 6, as the direction keeps its length. gain (7, 3N): by
    which these follow small changes of the points. inliers (N,). height, radial (N,): residuals of all points, mm.
    chi2 and dof: of the inliers.
    """

    centre: Floats
    direction: Floats
    radius: float
    covariance: Floats
    gain: Floats
    inliers: Bools
    height: Floats
    radial: Floats
    chi2: float
    dof: int

    @property
    def sigma_centre(self) -> Floats:
        """Standard deviations of the centre's coordinates (3,), mm."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def sigma_direction(self) -> float:
        """Standard deviation of the direction, rad: root of the mean over the two directions across it."""
        return float(np.sqrt(np.trace(self.covariance[3:6, 3:6]) / 2.0))

    @property
    def sigma_radius(self) -> float:
        """Standard deviation of the radius, mm."""
        return float(np.sqrt(self.covariance[6, 6]))

    @property
    def p_value(self) -> float:
        """Probability of residuals at least this large if the stated covariances are right."""
        return float(chi2_sf(self.chi2, self.dof)) if self.dof else 1.0


class _Shape(NamedTuple):
    centre: Floats
    direction: Floats
    radius: float


def fit_circle(points: Points, angles: ArrayLike | None = None) -> Circle:
    """The circle through `points`, in the order of the turn; outliers are left out and flagged.

    angles (N,), rad: of the joint that turned; they decide the sense of the direction. Without them the points turn
    positively. Raises NoCircle for fewer than three points, or points on a line.
    """
    if len(points) < 3:
        raise NoCircle(f"{len(points)} points do not determine a circle: measure at least 3, better 8 or more")
    inliers = np.ones(len(points), bool)
    start = _closed_form(points.xyz)
    while True:
        fitted = _Fit.of(points, inliers, start)
        worst = fitted.outlier() if np.count_nonzero(inliers) > LEAST_POINTS else None
        if worst is None:
            return fitted.circle(_sense(points.xyz, fitted.shape, angles))
        inliers = inliers.copy()
        inliers[worst] = False
        start = _closed_form(points.xyz[inliers])


def _closed_form(xyz: Floats) -> _Shape:
    """Plane of the points by SVD; in it 2 c·x + (r² − c²) = x² by linear least squares (Kåsa 1976)."""
    middle = xyz.mean(axis=0)
    _, spread, axes = np.linalg.svd(xyz - middle)
    if spread[1] < LEAST_ARC * spread[0]:
        raise NoCircle("the points lie on a line, or are one point: turn the joint through a larger angle")
    flat = (xyz - middle) @ axes[:2].T
    lines = np.column_stack([2.0 * flat, np.ones(len(flat))])
    x, y, rest = np.linalg.lstsq(lines, (flat**2).sum(axis=1), rcond=None)[0]
    return _Shape(middle + axes[0] * x + axes[1] * y, axes[2], float(np.sqrt(max(rest + x * x + y * y, 0.0))))


@final
@dataclass(frozen=True, eq=False)
class _Fit:
    """The fit to the inliers; arrays of 2 rows for each of the M inliers (height, radial) and 6 parameters."""

    points: Points
    inliers: Bools
    shape: _Shape
    residual: Floats
    jacobian: Floats
    covariance: Floats
    projection: Floats

    @classmethod
    def of(cls, points: Points, inliers: Bools, start: _Shape) -> _Fit:
        mine = points.pick(inliers)
        together, shape = mine.joint_covariance(), start
        for _ in range(STEPS):
            fit = cls._at(points, inliers, shape, mine.xyz, together)
            rows, residual = whitened(fit.covariance, fit.jacobian, fit.residual)
            step = np.asarray(np.linalg.lstsq(rows, -residual, rcond=None)[0], float)
            shape = _stepped(shape, step)
            if np.abs(step / ([1.0 / shape.radius] * 2 + [1.0] * 4)).max() < 1e-9:
                break
        return cls._at(points, inliers, shape, mine.xyz, together)

    @classmethod
    def _at(cls, points: Points, inliers: Bools, shape: _Shape, xyz: Floats, together: Floats) -> _Fit:
        e1, e2 = _across(shape.direction)
        away, height, outward, distance = _cylindrical(xyz, shape)
        count = len(xyz)
        jacobian = np.zeros((count, 2, 6))
        jacobian[:, 0, :2], jacobian[:, 0, 4] = away @ np.column_stack([e1, e2]), -1.0
        jacobian[:, 1, 2:4], jacobian[:, 1, 5] = -outward @ np.column_stack([e1, e2]), -1.0
        projection = np.zeros((count, 2, count, 3))
        projection[np.arange(count), 0, np.arange(count)] = shape.direction
        projection[np.arange(count), 1, np.arange(count)] = outward
        flat = projection.reshape(2 * count, 3 * count)
        residual = np.column_stack([height, distance - shape.radius]).ravel()
        return cls(points, inliers, shape, residual, jacobian.reshape(-1, 6), flat @ together @ flat.T, flat)

    def _normal_inverse(self) -> tuple[Floats, Floats]:
        """P = (Jᵀ W J)⁻¹ (6, 6), and the whitened Jacobian L⁻¹ J (2M, 6), W⁻¹ = L Lᵀ."""
        (rows,) = whitened(self.covariance, self.jacobian)
        return np.asarray(np.linalg.pinv(rows.T @ rows, hermitian=True)), rows

    def outlier(self) -> int | None:
        """Index of the point whose removal lowers χ² most, if by more than chance allows; otherwise None.

        Baarda's test for correlated rows: (W v)_iᵀ (W − W J P Jᵀ W)_ii⁻¹ (W v)_i is χ² with 2 degrees of freedom. It is
        divided by its median where all rows scatter more than stated.
        """
        inverse, _ = self._normal_inverse()
        weight = np.linalg.inv(self.covariance)
        pulled = (weight @ self.residual).reshape(-1, 2)
        rest = weight - weight @ self.jacobian @ inverse @ self.jacobian.T @ weight
        blocks = np.stack([rest[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] for i in range(len(pulled))])
        tests = np.einsum("ni,nij,nj->n", pulled, np.linalg.pinv(blocks, hermitian=True), pulled)
        tests /= max(1.0, float(np.median(tests)) / chi2_ppf(0.5, 2))
        worst = int(tests.argmax())
        if tests[worst] < chi2_isf(OUTLYING / len(tests), 2):
            return None
        return int(np.flatnonzero(self.inliers)[worst])

    def circle(self, sense: float) -> Circle:
        """The result, its direction times `sense` (1 or −1)."""
        inverse, rows = self._normal_inverse()
        e1, e2 = _across(self.shape.direction)
        spread = np.zeros((7, 6))
        spread[:3, 2:5] = np.column_stack([e1, e2, self.shape.direction])
        spread[3:6, :2] = sense * np.column_stack([e1, e2])
        spread[6, 5] = 1.0
        (projection,) = whitened(self.covariance, self.projection)
        gain = np.zeros((7, len(self.inliers), 3))
        gain[:, self.inliers] = (-spread @ inverse @ rows.T @ projection).reshape(7, -1, 3)
        (residual,) = whitened(self.covariance, self.residual)
        _, height, _, distance = _cylindrical(self.points.xyz, self.shape)
        return Circle(
            self.shape.centre,
            sense * self.shape.direction,
            self.shape.radius,
            spread @ inverse @ spread.T,
            gain.reshape(7, -1),
            self.inliers,
            height,
            distance - self.shape.radius,
            float(residual @ residual),
            len(residual) - 6,
        )


def _stepped(shape: _Shape, step: Floats) -> _Shape:
    """Tilt along e1, e2; centre along e1, e2, axis; radius."""
    e1, e2 = _across(shape.direction)
    direction = shape.direction + step[0] * e1 + step[1] * e2
    centre = shape.centre + step[2] * e1 + step[3] * e2 + step[4] * shape.direction
    return _Shape(centre, direction / np.linalg.norm(direction), shape.radius + float(step[5]))


def _cylindrical(xyz: Floats, shape: _Shape) -> tuple[Floats, Floats, Floats, Floats]:
    """From centre (N, 3), height (N,), unit vector away from the axis (N, 3), distance from it (N,)."""
    away = xyz - shape.centre
    height = away @ shape.direction
    flat = away - height[:, None] * shape.direction
    distance = np.linalg.norm(flat, axis=1)
    return away, height, flat / np.maximum(distance, 1e-9)[:, None], distance


def _across(direction: Floats) -> tuple[Floats, Floats]:
    """Two unit vectors (3,) perpendicular to `direction` and to each other."""
    e1 = np.cross(np.eye(3)[np.abs(direction).argmin()], direction)
    e1 /= np.linalg.norm(e1)
    return e1, np.cross(direction, e1)


def _sense(xyz: Floats, shape: _Shape, angles: ArrayLike | None) -> float:
    """1 where the points turn positively about the direction as the angles grow, −1 otherwise."""
    away = xyz - shape.centre
    turned = np.cross(away[:-1], away[1:]) @ shape.direction
    growth = np.ones(len(turned)) if angles is None else np.diff(np.asarray(angles, float))
    return 1.0 if float(turned @ np.sign(growth)) >= 0.0 else -1.0


LEAST_DISTANCE_MM = 10.0
"""Distance of A1 and A2 above which {B}'s x points from A1 to A2; below, it is the direction z1 × z2.

Axes that meet by design (UR, iiwa) are some mm apart as built and as circles show them, to either side; those that do
not meet are 25 mm apart or more in the library.
"""

_STEPS = np.array([*[1e-3] * 3, *[1e-6] * 3])
"""Steps of central differences by a place (mm) and by a direction."""


class ParallelAxes(ValueError):
    """Two axes have no common perpendicular direction; the text says which and what to do."""


class Line(NamedTuple):
    """A joint's axis: a point on it (3,), mm, and its unit direction (3,)."""

    point: Floats
    direction: Floats


@final
@dataclass(frozen=True, eq=False)
class Turn:
    """One joint turned alone. points: N of the reflector; angles (N,), rad: the joint's model angle at each."""

    points: Points
    angles: Floats


@final
@dataclass(frozen=True, eq=False)
class AxisFrames:
    """What the circles give, in the instrument's frame. base: {B}; tool: {T}; circles: of A1, A2, A5, A6.

    reflector_in_wrist (3,), mm, with covariance (3, 3): the reflector from the point of A6 nearest to A5, along {T}'s
    axes. It does not depend on where the instrument is.
    """

    base: MeasuredPose
    tool: MeasuredPose
    circles: tuple[Circle, Circle, Circle, Circle]
    reflector_in_wrist: Floats
    reflector_covariance: Floats


def axis_frames(a1: Turn, a2: Turn, a5: Turn, a6: Turn, reflector: Points) -> AxisFrames:
    """{B} and {T} from the four turns, each begun from one and the same posture, where `reflector` (one point) is.

    The common part of the instrument's error is carried through all circles together. Raises NoCircle, ParallelAxes.
    """
    turns = (a1, a2, a5, a6)
    circles = tuple(fit_circle(turn.points, turn.angles) for turn in turns)
    covariance = _covariance(circles, Points.joined([*(turn.points for turn in turns), reflector]))
    values = np.concatenate([*(np.append(one.centre, one.direction) for one in circles), reflector.xyz[0]])
    base, tool, place = _frames(values)
    change = _central_differences(lambda moved: _differences(_frames(moved), (base, tool, place)), values)
    spread = change @ covariance @ change.T
    return AxisFrames(
        MeasuredPose(base, spread[:6, :6]),
        MeasuredPose(tool, spread[6:12, 6:12]),
        (circles[0], circles[1], circles[2], circles[3]),
        place,
        spread[12:, 12:],
    )


def base_frame(a1: Line, a2: Line) -> Floats:
    """{B} (4, 4) in the frame of the lines. Raises ParallelAxes."""
    across = _perpendicular(a1, a2, "A1 and A2")
    foot, other = _nearest(a1, a2), _nearest(a2, a1)
    if (other - foot) @ across < -LEAST_DISTANCE_MM:
        across = -across
    return pose(np.column_stack([across, np.cross(a1.direction, across), a1.direction]), foot)


def wrist_frame(a5: Line, a6: Line) -> Floats:
    """Frame (4, 4): x on A6's axis, z along z5 × z6, origin at A6's point nearest to A5. Raises ParallelAxes."""
    up = _perpendicular(a5, a6, "A5 and A6")
    x = a6.direction
    return pose(np.column_stack([x, np.cross(up, x), up]), _nearest(a6, a5))


def axes_of(chain: SerialChain, q: ArrayLike) -> list[Line]:
    """The joints' axes in the robot's base frame at model angles q (n,), rad."""
    frames = chain.with_base(np.eye(4)).frames(q)
    return [Line(frame[:3, 3], frame[:3, 2]) for frame in frames[:-1]]


def station(frames: AxisFrames, chain: SerialChain, q: ArrayLike) -> MeasuredPose:
    """The instrument in the robot's base frame: nominal {B} · measured {B}⁻¹.

    q (n,), rad: the posture from which the turns were begun. The covariance contains the measurement alone: errors of
    nominal A1 and A2 against each other come on top.
    """
    lines = axes_of(chain, q)
    return frames.base.inverse().within(base_frame(lines[0], lines[1]))


def reflector_on_flange(frames: AxisFrames, chain: SerialChain, q: ArrayLike) -> tuple[Floats, Floats]:
    """The reflector's centre (3,), mm, in the nominal flange frame, and its covariance (3, 3)."""
    lines, flange = axes_of(chain, q), chain.with_base(np.eye(4)).forward_flange(q)
    wrist = inverse_pose(flange) @ wrist_frame(lines[-2], lines[-1])
    turn = wrist[:3, :3]
    return wrist[:3, 3] + turn @ frames.reflector_in_wrist, turn @ frames.reflector_covariance @ turn.T


def _covariance(circles: tuple[Circle, ...], points: Points) -> Floats:
    """Of centre and direction of each circle, and the reflector (27, 27)."""
    sizes = [circle.gain.shape[1] for circle in circles]
    gain = np.zeros((6 * len(circles) + 3, sum(sizes) + 3))
    column = 0
    for index, circle in enumerate(circles):
        gain[6 * index : 6 * index + 6, column : column + sizes[index]] = circle.gain[:6]
        column += sizes[index]
    gain[-3:, -3:] = np.eye(3)
    return np.asarray(gain @ points.joint_covariance() @ gain.T)


def _frames(values: Floats) -> tuple[Floats, Floats, Floats]:
    a1, a2, a5, a6 = (Line(part[:3], part[3:] / np.linalg.norm(part[3:])) for part in values[:24].reshape(4, 6))
    wrist, reflector = wrist_frame(a5, a6), values[24:]
    return base_frame(a1, a2), pose(wrist[:3, :3], reflector), wrist[:3, :3].T @ (reflector - wrist[:3, 3])


def _differences(moved: tuple[Floats, Floats, Floats], at: tuple[Floats, Floats, Floats]) -> Floats:
    slides = [pose_difference(moved[index], at[index]) for index in (0, 1)]
    return np.concatenate([*slides, moved[2] - at[2]])


def _central_differences(function: Callable[[Floats], Floats], at: Floats) -> Floats:
    steps = np.append(np.tile(_STEPS, len(at) // 6), [_STEPS[0]] * (len(at) % 6))
    columns = [function(at + d) - function(at - d) for d in np.diag(steps)]
    return np.stack(columns, axis=1) / (2.0 * steps)


def _perpendicular(one: Line, other: Line, names: str) -> Floats:
    across = np.cross(one.direction, other.direction)
    length = float(np.linalg.norm(across))
    if length < 0.05:
        raise ParallelAxes(f"the axes of {names} are parallel within 3°: turn the robot to another posture")
    return np.asarray(across / length)


def _nearest(one: Line, other: Line) -> Floats:
    """The point of line `one` nearest to line `other`."""
    between, u, v = other.point - one.point, one.direction, other.direction
    cosine = u @ v
    return np.asarray(one.point + u * ((between @ u - cosine * (between @ v)) / (1.0 - cosine**2)))
