"""Three set-ups of a study, drawn: a robot from the prior, what is measured of it, and where it is asked afterwards.

SPH: the KR5 touches three spheres of certified spacing. Positions: a tracker sees a reflector on a UR10. Poses: a
tracker sees a six-dimensional target on a KR5. Where instrument and target are, nobody knows.

`fixed`: positions measured with the tool in one or two orientations only, as many a program leaves them. `MISJUDGED`:
draws whose fit gets something wrong: noise scale, tolerances of the robot, outliers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from tests.helpers.own_model import (
    ErrorsOfJoints,
    Floats,
    OwnArm,
    OwnPoses,
    OwnPositions,
    OwnPrior,
    OwnRows,
    OwnTouches,
    between,
    kr5,
    pose_of,
    small_motion,
    ur10,
)

SIGMA_MM = 0.03
SIGMA_RAD = 1e-4
PRIOR = OwnPrior()
SPHERES = np.array([[950.0, -350.0, 250.0], [950.0, 350.0, 250.0], [1150.0, 0.0, 400.0]])
REACH = 61.4 / 2 + 0.6
ROWS = 50
ASKED = 40
NOTHING: Mapping[str, float] = MappingProxyType({})
KR5_SIGNS = np.array([-1, 1, 1, -1, 1, -1])
KR5_REGION = np.radians([[-90, -110, 40, -90, -80, -120], [90, -40, 120, 90, 80, 120]])
UR10_REGION = np.radians([[-120, -130, 30, -150, -140, -170], [120, -30, 120, 0, -30, 170]])
TOUCHED_REGION = np.radians([[-40, -110, 40, -90, 10, -90], [40, -40, 120, 90, 90, 90]])

DOWN = np.radians([0.0, -100.0, 110.0, -100.0, -90.0, 20.0])
"""A UR10 with its tool pointing down, in the middle of where it works."""
FIXED_ROWS, FIXED_ASKED = 45, 20
UPRIGHT = Rotation.identity()
TILTED = Rotation.from_euler("x", 40.0, degrees=True)

WILD_ROWS = 3


@dataclass(frozen=True, eq=False)
class Draw:
    """nominal: what the fit is told; truth: what was measured, at `rows`. free: names of all that is unknown, those
    that begin with one of `flat` quite so. centres, rough_centres (S, 3): of the spheres. rough: nominal where somebody
    would say that base and tool are. asked (M, n): angles at which the robot is asked afterwards. told: the prior
    that the fit is given.
    """

    nominal: OwnArm
    truth: OwnArm
    rough: OwnArm
    rows: OwnRows
    free: tuple[str, ...]
    flat: tuple[str, ...]
    asked: Floats
    centres: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    rough_centres: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    told: OwnPrior = PRIOR


def sph(
    seed: int,
    added: Mapping[str, float] = NOTHING,
    besides: ErrorsOfJoints | None = None,
    *,
    errors: Mapping[str, float] = NOTHING,
    count: int = ROWS,
) -> Draw:
    """50 touches on three spheres by a KR5 that stands where it stands; its tool is taught, the centres are unknown.

    added: errors (mm, rad) beyond those that the prior draws; errors: in their place; besides: errors that no model
    here has; count: of the rows; so below.
    """
    rng = np.random.default_rng([seed, 1])
    nominal = kr5()
    names = (*nominal.link_names, "tool_x", "tool_y", "tool_z", "tool_deflection")
    truth = replace(erroneous(rng, nominal, names, added, errors), joint_errors=besides)
    centres = SPHERES + rng.normal(0.0, 3.0, SPHERES.shape)
    sphere = np.arange(count) % len(SPHERES)
    q = _touching(rng, truth, centres[sphere])
    certified = between(centres) + rng.normal(0.0, 0.01, 3)
    rows = OwnTouches(q, sphere, REACH, SIGMA_MM, certified, 0.01)
    free = (*names, *(f"S{number}_{axis}" for number in (1, 2, 3) for axis in "xyz"))
    asked = _within(rng, TOUCHED_REGION, ASKED) * KR5_SIGNS
    return Draw(nominal, truth, nominal, rows, free, ("S",), asked, centres, SPHERES)


def positions(
    seed: int,
    added: Mapping[str, float] = NOTHING,
    besides: ErrorsOfJoints | None = None,
    *,
    errors: Mapping[str, float] = NOTHING,
    count: int = ROWS,
) -> Draw:
    """50 points of a reflector on a UR10."""
    rng = np.random.default_rng([seed, 2])
    q = _within(rng, UR10_REGION, count)
    asked = _within(rng, UR10_REGION, ASKED)
    return seen_by_tracker(rng, ur10(), q, asked, added=added, besides=besides, errors=errors)


def poses(seed: int, added: Mapping[str, float] = NOTHING, besides: ErrorsOfJoints | None = None) -> Draw:
    """50 poses of a target on a KR5."""
    rng = np.random.default_rng([seed, 3])
    q = _within(rng, KR5_REGION, ROWS)
    asked = _within(rng, KR5_REGION, ASKED)
    return seen_by_tracker(rng, kr5(), q, asked, added=added, besides=besides, whole_poses=True)


SETUPS: dict[str, Callable[..., Draw]] = {"SPH": sph, "positions": positions, "poses": poses}
OUTSIDE: dict[str, dict[str, float]] = {
    "joint zeros by 1°": {"theta2": np.radians(1.0), "theta3": -np.radians(1.0), "theta5": np.radians(1.0)},
    "links by 3 mm": {"a2": 3.0, "d4": -3.0},
}
"""Errors far beyond the prior's 0.05° and 0.5 mm: a lost mastering; a robot of another series."""


def erroneous(
    rng: np.random.Generator,
    nominal: OwnArm,
    names: tuple[str, ...],
    added: Mapping[str, float] = NOTHING,
    errors: Mapping[str, float] = NOTHING,
) -> OwnArm:
    """`nominal` with errors from the prior, or `errors` in their place, and those `added`; a bend is never upwards."""
    drawn = rng.normal(0.0, [PRIOR.sigma(name, ()) for name in names])
    drawn = np.array([errors.get(name, own) for name, own in zip(names, drawn.tolist(), strict=True)])
    down = np.array([name == "tool_deflection" for name in names])
    return nominal.moved(names, np.where(down, np.abs(drawn), drawn)).moved(list(added), list(added.values()))


def seen_by_tracker(
    rng: np.random.Generator,
    nominal: OwnArm,
    q: Floats,
    asked: Floats,
    *,
    added: Mapping[str, float] = NOTHING,
    besides: ErrorsOfJoints | None = None,
    errors: Mapping[str, float] = NOTHING,
    whole_poses: bool = False,
) -> Draw:
    """What a tracker that stands anywhere sees of a target anywhere on the flange of a robot with errors."""
    place = pose_of(Rotation.random(random_state=rng), rng.uniform(-2000.0, 2000.0, 3))
    target = nominal.tool @ small_motion(np.concatenate([rng.uniform(-60, 60, 3), rng.uniform(-0.5, 0.5, 3)]))
    truth = erroneous(rng, nominal, nominal.link_names, added, errors)
    truth = replace(truth, base=place, tool=target, joint_errors=besides)
    roughly = [small_motion(rng.normal(0.0, [3.0] * 3 + [0.003] * 3)) for _ in range(2)]
    rough = replace(nominal, base=place @ roughly[0], tool=target @ roughly[1])
    xyz = truth.points(q) + rng.normal(0.0, SIGMA_MM, (len(q), 3))
    base, tool = (tuple(f"{frame}_{letter}" for letter in "xyzabc") for frame in ("base", "tool"))
    free = (*base, *nominal.link_names, *(tool if whole_poses else tool[:3]))
    rows: OwnRows = OwnPositions(q, xyz, SIGMA_MM)
    if whole_poses:
        rows = OwnPoses(q, _noisily_turned(rng, truth.poses(q), xyz), SIGMA_MM, SIGMA_RAD)
    return Draw(nominal, truth, rough, rows, free, ("base_", "tool_"), asked)


def _within(rng: np.random.Generator, region: Floats, count: int) -> Floats:
    return rng.uniform(region[0], region[1], (count, 6))


def _noisily_turned(rng: np.random.Generator, exact: Floats, xyz: Floats) -> Floats:
    noise = Rotation.from_rotvec(rng.normal(0.0, SIGMA_RAD, (len(exact), 3)))
    result = np.tile(np.eye(4), (len(exact), 1, 1))
    result[:, :3, :3], result[:, :3, 3] = noise.as_matrix() @ exact[:, :3, :3], xyz
    return result


def _touching(rng: np.random.Generator, truth: OwnArm, centres: Floats) -> Floats:
    """Angles (N, 6) at which the tip is REACH ± noise from its centre, on the side away from the table."""
    q = np.zeros((len(centres), 6))
    left = np.arange(len(centres))
    while left.size:
        away = rng.normal(size=(left.size, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        away[:, 2] = np.where(away[:, 2] < -0.3, -away[:, 2], away[:, 2])
        goal = centres[left] + (REACH + rng.normal(0.0, SIGMA_MM, (left.size, 1))) * away
        shaken = rng.uniform(-25, 25, (left.size, 6)) * [1, 1, 1, 3, 1, 4]
        start = KR5_SIGNS * np.radians(np.array([0.0, -70.0, 80.0, 0.0, 60.0, 0.0]) + shaken)
        found = truth.reaching(goal, start)
        close = np.linalg.norm(truth.points(found) - goal, axis=1) < 1e-9
        good = close & (np.abs(found[:, :3] - start[:, :3]) < 1.5).all(axis=1)
        q[left[good]] = found[good]
        left = left[~good]
    return q


def fixed(seed: int, turns: Sequence[Rotation]) -> tuple[Draw, Floats]:
    """45 points of a UR10 within 0.6 m, its tool turned from straight down by each of `turns` in turn, as its
    controller commands it, asked at the same; and angles (20, 6) at which the tool is turned by up to 40° otherwise.
    """
    rng = np.random.default_rng([seed, 5])
    q, same = _angles(rng, FIXED_ROWS, turns), _angles(rng, FIXED_ASKED, turns)
    others = [Rotation.from_euler("zyx", rng.uniform(-40.0, 40.0, 3), degrees=True) for _ in range(FIXED_ASKED)]
    return seen_by_tracker(rng, ur10(), q, same), _angles(rng, FIXED_ASKED, others)


def _angles(rng: np.random.Generator, count: int, turns: Sequence[Rotation]) -> Floats:
    arm, q, left = ur10(), np.zeros((count, 6)), np.arange(count)
    middle = arm.poses(DOWN[None])[0]
    while left.size:  # a place that is out of reach in its orientation is drawn again
        wanted = np.tile(middle, (left.size, 1, 1))
        wanted[:, :3, 3] += rng.uniform(-300.0, 300.0, (left.size, 3))
        wanted[:, :3, :3] = np.array([turns[i % len(turns)].as_matrix() @ middle[:3, :3] for i in left.tolist()])
        q[left] = arm.held(wanted, np.tile(DOWN, (left.size, 1)))
        left = left[~np.isclose(arm.poses(q[left]), wanted, atol=1e-7).all(axis=(1, 2))]
    return q


def rows_noisier_than_said(draw: Draw, factor: float) -> Draw:
    """The fit is told σ that are too small by `factor`; certified spacings are as good as their certificate."""
    match draw.rows:
        case OwnPoses() as rows:
            said = replace(rows, sigma_mm=rows.sigma_mm / factor, sigma_rad=rows.sigma_rad / factor)
            return replace(draw, rows=said)
        case OwnPositions() | OwnTouches() as rows:
            return replace(draw, rows=replace(rows, sigma_mm=rows.sigma_mm / factor))
        case _:
            raise TypeError(type(draw.rows))


def robot_worse_than_said(draw: Draw, factor: float) -> Draw:
    """The fit is told tolerances of the links and joint zeros that are too tight by `factor`."""
    told = OwnPrior(
        link_mm=PRIOR.link_mm / factor,
        angle_deg=PRIOR.angle_deg / factor,
        joint_zero_deg=PRIOR.joint_zero_deg / factor,
    )
    return replace(draw, told=told)


def wild_rows(draw: Draw, how_many: int = WILD_ROWS) -> list[int]:
    """Which rows `with_wild_rows` makes wild."""
    return sorted(_rng_of(draw).choice(len(draw.rows.q), how_many, replace=False).tolist())


def with_wild_rows(draw: Draw, sigmas: float, how_many: int = WILD_ROWS) -> Draw:
    """Some rows are off by `sigmas` standard deviations: in a random direction, or along the sphere's normal."""
    rng = _rng_of(draw)
    outlying = rng.choice(len(draw.rows.q), how_many, replace=False)
    away = rng.normal(size=(how_many, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    match draw.rows:
        case OwnPositions() as rows:
            xyz = rows.xyz.copy()
            xyz[outlying] += sigmas * rows.sigma_mm * away
            return replace(draw, rows=replace(rows, xyz=xyz))
        case OwnPoses() as rows:
            poses = rows.poses.copy()
            poses[outlying, :3, 3] += sigmas * rows.sigma_mm * away
            return replace(draw, rows=replace(rows, poses=poses))
        case OwnTouches() as rows:
            q, tips = rows.q.copy(), draw.truth.points(rows.q)[outlying]
            normal = (tips - draw.centres[rows.sphere[outlying]]) / rows.reach
            q[outlying] = draw.truth.reaching(
                tips + sigmas * rows.sigma_mm * np.sign(away[:, :1]) * normal, q[outlying]
            )
            return replace(draw, rows=replace(rows, q=q))
        case _:
            raise TypeError(type(draw.rows))


def _rng_of(draw: Draw) -> np.random.Generator:
    return np.random.default_rng([len(draw.rows.q), int(draw.asked[0, 0] * 1e6) % 2**31])


MISJUDGED: dict[str, Callable[[Draw], Draw]] = {
    "rows 1.5 × noisier than stated": lambda draw: rows_noisier_than_said(draw, 1.5),
    "rows 3 × noisier than stated": lambda draw: rows_noisier_than_said(draw, 3.0),
    "robot 2 × less accurate than stated": lambda draw: robot_worse_than_said(draw, 2.0),
    "3 outliers in 50, 6 σ": lambda draw: with_wild_rows(draw, 6.0),
    "3 outliers in 50, 15 σ": lambda draw: with_wild_rows(draw, 15.0),
}
