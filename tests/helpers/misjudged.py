"""Draws whose fit is told something wrong: rows noisier than said, a robot further off, wild rows among them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.helpers.own_posterior import OwnPrior
from tests.helpers.own_rows import OwnPoses, OwnPositions, OwnTouches
from tests.helpers.simulated_setups import PRIOR, Draw

WILD_ROWS = 3


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
