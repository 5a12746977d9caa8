"""Spatial similarity of a robot's errors in joint and Cartesian space (KRG 2.3, 3.1), with its Mantel test.

N rows make N(N−1)/2 pairs, but they are not independent: each row is in N−1 of them. The usual p-value of Pearson's
correlation takes them as independent and is far too small. Mantel's test (Mantel 1967, Cancer Research 27) permutes
the rows instead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.spatial.distance import pdist, squareform
from scipy.special import betainc

from cellctl.error_maps.kriging import EmpiricalSemivariogram, semivariogram
from cellctl.error_maps.samples import Scale
from cellctl.kinematics import Floats

LEAST_POSTURES = 20
"""Fewer postures give fewer than 190 pairs: less than ten for each of the 20 bins of a semivariogram."""

MOVES_DEG = 0.05
"""A joint whose readings have a smaller standard deviation counts as one that never moves."""

CONSTANT_MM = 1e-6
"""A component of the errors with a smaller standard deviation is constant: it was computed, not measured."""

_SAME_DEG = 1e-6


@final
class UnsuitableRows(Exception):
    """The rows do not allow an analysis; the text is what is wrong, ": " and the cure."""


@final
@dataclass(frozen=True, slots=True, eq=False)
class ErrorSet:
    """Errors at N different postures.

    readings (N, n), deg; places (N, 3): nominal TCP, mm; errors (N, 3): measured less nominal, mm, both in the robot's
    base frame. repeats: rows averaged away, as they repeat a posture.
    """

    readings: Floats
    places: Floats
    errors: Floats
    repeats: int = 0

    @classmethod
    def of(cls, readings: Floats, places: Floats, errors: Floats) -> ErrorSet:
        """From rows, several of which may have one posture: these are averaged, so that no pair has distance 0.

        Raises UnsuitableRows for fewer than 20 postures, for errors that are constant in every component (positions
        were computed, not measured), and where no joint moves.
        """
        _, first, of = np.unique(np.round(readings / _SAME_DEG), axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)
        place_of = np.argsort(order)[of.reshape(-1)]
        count = np.bincount(place_of)[:, None]
        mean = np.stack([np.bincount(place_of, errors[:, axis]) for axis in range(3)], axis=1) / count
        chosen = first[order]
        found = cls(readings[chosen], places[chosen], mean, len(readings) - len(chosen))
        found._refuse()
        return found

    def __len__(self) -> int:
        return len(self.readings)

    @property
    def moving(self) -> tuple[bool, ...]:
        """Which joints (n,) move."""
        return tuple((self.readings.std(axis=0) > MOVES_DEG).tolist())

    @property
    def varying(self) -> tuple[bool, ...]:
        """Which components (x, y, z) of the errors vary."""
        return tuple((self.errors.std(axis=0) > CONSTANT_MM).tolist())

    def _refuse(self) -> None:
        if len(self) < LEAST_POSTURES:
            repeated = f" ({self.repeats} rows repeat one of them)" if self.repeats else ""
            what = f"{len(self)} different postures{repeated} are too few for 20 bins of pairs"
            raise UnsuitableRows(f"{what}: measure at {LEAST_POSTURES} postures or more, better 50")
        if not any(self.varying):
            what = "the errors are the same in all rows to 0.000001 mm, so X, Y, Z were computed and not measured"
            raise UnsuitableRows(f"{what}: fill in what the instrument measured")
        if not any(self.moving):
            raise UnsuitableRows(f"no joint moves by more than {MOVES_DEG}°: measure at different postures")


@final
@dataclass(frozen=True, slots=True)
class Correlation:
    """Pearson's r over all pairs; p: Mantel test, two-sided; p_if_independent: what a t test of r states, as published
    tables do. permutations, pairs: their numbers. 95 % of the permuted correlations lie in low_95…high_95.
    """

    r: float
    p: float
    p_if_independent: float
    permutations: int
    pairs: int
    low_95: float
    high_95: float


def mantel(
    errors: Floats, spaces: Mapping[str, Floats], permutations: int, rng: np.random.Generator
) -> dict[str, Correlation]:
    """Correlation of the distances between `errors` (N, k) with those between the points (N, m) of each of `spaces`.

    Two-sided: p = (1 + number of permutations with |r| at least as large) / (1 + permutations). All spaces have the
    same permutations. A space or errors without any distance has no correlation: NaN, p 1.
    """
    count = len(errors)
    apart = _centred(pdist(errors))
    others = np.array([_centred(pdist(points)) for points in spaces.values()])
    found = others @ apart
    square = squareform(apart)
    first, second = np.triu_indices(count, 1)
    permuted = np.empty((permutations, len(others)))
    for place in range(permutations):
        order = rng.permutation(count)
        permuted[place] = others @ square[order[first], order[second]]
    judged = [_judged(float(r), permuted[:, column], len(apart)) for column, r in enumerate(found)]
    return dict(zip(spaces, judged, strict=True))


def _judged(r: float, permuted: Floats, pairs: int) -> Correlation:
    if not np.isfinite(r):
        return Correlation(float("nan"), 1.0, 1.0, len(permuted), pairs, float("nan"), float("nan"))
    as_large = int(np.count_nonzero(np.abs(permuted) >= abs(r) - 1e-12))
    low, high = np.quantile(permuted, [0.025, 0.975]).tolist() if len(permuted) else (float("nan"),) * 2
    p = (1.0 + as_large) / (1.0 + len(permuted))
    return Correlation(r, p, _p_if_independent(r, pairs), len(permuted), pairs, low, high)


def _centred(distances: Floats) -> Floats:
    """Distances less their mean, of length 1, so that a scalar product is a correlation; NaN if all are equal."""
    away = distances - distances.mean()
    size = float(np.linalg.norm(away))
    return np.asarray(away / size) if size > 1e-9 * max(float(np.abs(distances).max()), 1e-300) else away * np.nan


def _p_if_independent(r: float, pairs: int) -> float:
    """Two-sided p-value of r among `pairs` independent pairs: Student's t with pairs − 2 degrees of freedom."""
    free = pairs - 2
    return float(betainc(free / 2.0, 0.5, max(0.0, 1.0 - r * r)))


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
