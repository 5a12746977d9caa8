"""Spatial similarity of a robot's errors in joint space and in Cartesian space (KRG 2.3 and 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.spatial.distance import pdist

from cellctl.analysis.correlation import Correlation, mantel
from cellctl.analysis.errors import ErrorSet
from cellctl.error_maps.kriging import EmpiricalSemivariogram, semivariogram
from cellctl.error_maps.samples import Scale
from cellctl.kinematics import Floats

COMPONENTS = ("x", "y", "z")
NEAR_SHARE = 0.1
"""A joint's second semivariogram uses the pairs among this share that are nearest to each other in the other joints."""


@final
@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """Numbers of the analysis, for N postures.

    correlation: of the distance De between two errors, for `3-D` (length of the difference), `x`, `y`, `z`; in each
    with the distance of the joints `Dq` and of the nominal positions `Dp`. Dq is the Euclidean distance of the
    readings, deg. overall: semivariogram of each component over the distance of standardised joints. by_joint,
    by_joint_near: of each component and each joint (by number from 1) over the standardised distance of that joint
    alone: of all pairs, as published, and of the tenth that is nearest in the other joints. dq, dp, de (pairs,): deg,
    mm, mm.

    Errors are standardised for the semivariograms: 1 is the variance. Constant components and joints that never move
    are left out.
    """

    correlation: dict[str, dict[str, Correlation]]
    overall: dict[str, EmpiricalSemivariogram]
    by_joint: dict[str, dict[int, EmpiricalSemivariogram]]
    by_joint_near: dict[str, dict[int, EmpiricalSemivariogram]]
    dq: Floats
    dp: Floats
    de: Floats


def similarity(rows: ErrorSet, permutations: int = 999, seed: int = 0) -> Similarity:
    """The analysis of `rows`. The same seed gives the same p-values."""
    spaces = {"Dq": rows.readings, "Dp": rows.places}
    parts = {"3-D": rows.errors}
    parts |= {name: rows.errors[:, [axis]] for axis, name in enumerate(COMPONENTS) if rows.varying[axis]}
    correlation = {
        name: mantel(part, spaces, permutations, np.random.default_rng([seed, 31])) for name, part in parts.items()
    }
    joints = [joint for joint, moves in enumerate(rows.moving) if moves]
    readings = rows.readings[:, joints]
    q = Scale.of(readings).standardised(readings)
    of = {name: Scale.of(part).standardised(part)[:, 0] for name, part in parts.items() if name != "3-D"}
    alone = {joint + 1: pdist(q[:, [column]]) for column, joint in enumerate(joints)}
    near = {joint + 1: _near_in_others(q, column) for column, joint in enumerate(joints)}
    return Similarity(
        correlation,
        {name: semivariogram(pdist(q), values) for name, values in of.items()},
        {name: {joint: semivariogram(h, values) for joint, h in alone.items()} for name, values in of.items()},
        {
            name: {joint: semivariogram(h, values, near[joint]) for joint, h in alone.items()}
            for name, values in of.items()
        },
        pdist(rows.readings),
        pdist(rows.places),
        pdist(rows.errors),
    )


def _near_in_others(q: Floats, column: int) -> Floats:
    """Mask of the pairs that are among the nearest tenth in all joints but that of `column`."""
    others = pdist(np.delete(q, column, axis=1)) if q.shape[1] > 1 else np.zeros(len(q) * (len(q) - 1) // 2)
    return np.asarray(others <= np.quantile(others, NEAR_SHARE))
