"""Start value of a fixed point's place, from the TCPs that were measured at it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.kinematics import Floats

CENTRE_STEPS = 8


def sphere_centre(tcps: Floats, reach: Any) -> Floats:
    """Centre (3,) of the sphere of radius `reach` (N,), mm, that fits the points `tcps` (N, 3) best.

    From the linear problem |p|² − ρ² = 2 p·c + k about the points' mean, and from both sides of the points along the
    direction of least spread, as the linear problem cannot determine the curvature of a small cap; then Gauss–Newton on
    the distances; the best fit is taken. Fewer than four points give the admissible centre nearest to the mean.
    """
    reach = np.broadcast_to(np.asarray(reach, float), len(tcps))
    mean = tcps.mean(axis=0)
    away = tcps - mean
    lines = np.concatenate([2.0 * away, np.ones((len(tcps), 1))], axis=1)
    linear = np.linalg.lstsq(lines, np.sum(away**2, axis=1) - reach**2, rcond=1e-6)[0][:3]
    across = reach.mean() * np.linalg.eigh(away.T @ away)[1][:, 0]
    found = [_nearer_centre(away, reach, start) for start in (linear, across, -across)]
    return np.asarray(mean + min(found, key=lambda centre: _off_surface(away, reach, centre)))


def _nearer_centre(points: Floats, reach: Floats, centre: Floats) -> Floats:
    """Gauss–Newton on the points' distances from `centre` (3,), while these get closer to `reach`."""
    for _ in range(CENTRE_STEPS):
        away = points - centre
        distance = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        tried = centre + np.linalg.lstsq(-away / distance[:, None], reach - distance, rcond=1e-6)[0]
        if _off_surface(points, reach, tried) >= _off_surface(points, reach, centre):
            break
        centre = tried
    return centre


def _off_surface(points: Floats, reach: Floats, centre: Floats) -> float:
    return float(np.sum((np.linalg.norm(points - centre, axis=1) - reach) ** 2))
