"""Certified distances as the rows predict them, with what the model lacks and second centres, and contradictions.

A fit ends in one of the two, and its σ does not include the other. So each is tried, with the whole robot fitted to it.

Noise averages out over the visits of a point, a smooth error of the robot does not: visits at similar joints share it.
So the scatter of the residuals beyond the stated σ is taken as such an error δ(q), a Gaussian process on each axis, and
carried through the fit. With the gain G = −L C Jᵀ of the fit (L: distances by the parameters, C: their covariance, J:
rows by the parameters, in standard deviations) and A the rows by a shift of the TCP, a distance errs by G A δ, and

    cov = (G A) K (G A)ᵀ,  K_ij = s_i s_j exp(−‖q_i − q_j‖²/2l²)

A Panda's spacing of 50 mm was refused without it: 49.36 ± 0.08 mm at one place of the plate, 49.9 at the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np
from scipy.spatial.distance import cdist

from cellctl.calibration.model.unknowns import State
from cellctl.calibration.rows import Measured, SpacingRows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate, estimate
from cellctl.kinematics import Bools, Floats

AS_GOOD = 36.0
"""A second centre whose χ² is greater by at most this, six σ, may be the right one."""

APART_MM = 0.3
"""Centres nearer to each other than this are one."""

STEPS = 20
"""Steps towards a second centre, with the robot fixed, before the robot is fitted too."""


def with_best_centres(found: Estimate, rows: RowBlocks) -> tuple[Estimate, Bools]:
    """`found`, or a better fit of `rows` with other centres; and which points (S,) may also be at another place."""
    points = len(found.state.points)
    open_ = np.zeros(points, bool)
    for point in range(points):
        mirrored = _mirrored(found.state, rows, point)
        if mirrored is None:
            continue
        begin = found.deviations.copy()
        begin[found.state.of_points].reshape(-1, 3)[point] += mirrored - found.state.points[point]
        other = estimate(found.unknowns, rows.blocks, begin)
        if np.linalg.norm(other.state.points[point] - found.state.points[point]) < APART_MM:
            continue
        open_[point] = abs(other.cost - found.cost) < AS_GOOD
        found = other if other.cost < found.cost else found
    return found, open_


def _mirrored(state: State, rows: RowBlocks, point: int) -> Floats | None:
    """Place (3,) of a point on the other side of its touches; None without touches, or if the fit returns."""
    tcps, lengths = _touched(state, rows, point)
    if not len(tcps):
        return None
    away = state.points[point] - tcps.mean(axis=0)
    normal = np.linalg.svd(tcps - tcps.mean(axis=0))[2][-1]
    centre = state.points[point] - 2.0 * (away @ normal) * normal
    for _ in range(STEPS):
        between = centre - tcps
        distance = np.maximum(np.linalg.norm(between, axis=1), 1e-9)
        centre = centre - np.linalg.lstsq(between / distance[:, None], distance - lengths, rcond=1e-6)[0]
    return None if np.linalg.norm(centre - state.points[point]) < APART_MM else np.asarray(centre)


def _touched(state: State, rows: RowBlocks, point: int) -> tuple[Floats, Floats]:
    """TCPs (N, 3) at the touches of a point, and their distances (N,) from it."""
    tcps, lengths = [np.zeros((0, 3))], [np.zeros(0)]
    for block in rows.blocks:
        if block.distances is not None:
            mine = block.visited == point
            tcps.append(state.models[block.session].tcp(block.postures)[mine])
            lengths.append(block.lengths(state)[mine])
    return np.concatenate(tcps), np.concatenate(lengths)


LENGTHS_RAD = (0.25, 0.5, 1.0, 2.0)
"""The length l with the largest error counts. A fit's own discrepancy has 1 rad and more: shorter ones are left."""

SPREAD = 0.64
"""Log-normal prior of δ's standard deviation s about the scatter of the rows: 1 σ of its logarithm. The fit has taken
up a part of the error already, so s is larger than what is left; its root mean square is e^(0.64²) = 1.5 times that."""

MOST_MM = 0.5
"""Upper bound of s on each axis: a UR10 with geometry alone leaves 0.4 mm. Rows that scatter more show a wrong robot
file, and must not make every certificate acceptable."""

BLOCKS_AT_LEAST = 5
"""Of fewer estimates of one distance, at different places, the scatter is not known: of three, within a factor of 4."""


def model_errors(spacings: SpacingRows, found: Estimate, rows: RowBlocks, noise: Floats) -> Floats:
    """Covariance (K, K), mm², of the distances `spacings` as estimated in `found` from `rows` with `noise` (Q,), by a
    discrepancy with a bounded prior; or by the scatter of at least `BLOCKS_AT_LEAST` estimates of one distance, where
    that is larger.
    """
    lines = spacings.jacobian(found.state)[:, 0]
    carried = lines @ found.covariance
    share = max(1.0 - found.effective_parameters / max(rows.size, 1), 1.0 / max(rows.size, 1))
    gains, sizes, angles = [], [], []
    for block, _, own in rows.parts():
        if len(block):
            sigma = block.sigma * noise[own]
            columns = block.jacobian(found.state) / sigma[..., None]
            gain = -np.einsum("kp,nmp->knm", carried, columns)
            gains.append(np.einsum("knm,nmx->knx", gain, columns[..., _shifts(found, block.session)]))
            sizes.append(np.full(len(block), _size(block, found, share)))
            angles.append(block.q)
    gain, size, q = np.concatenate(gains, axis=1), np.concatenate(sizes), np.concatenate(angles)
    apart = cdist(q, q, "sqeuclidean")
    smooth = [np.outer(size, size) * np.exp(-0.5 * apart / length**2) for length in LENGTHS_RAD]
    by_length = [np.einsum("knx,nm,jmx->kj", gain, kernel, gain, optimize=True) for kernel in smooth]
    covariance = max(by_length, key=np.trace)
    among = _among_blocks(spacings, found, lines)
    return np.asarray(covariance + np.diag(np.maximum(among - np.diag(covariance), 0.0)))


def _shifts(found: Estimate, session: int) -> list[int]:
    """Columns of a shift of the robot's base, and so of the TCP, along x, y, z."""
    names = list(found.state.model.names)
    return [int(found.state.columns[session][names.index(f"base_{axis}")]) for axis in "xyz"]


def _size(block: Measured, found: Estimate, share: float) -> float:
    """s, 1 σ on each axis, mm, of a block's rows; share: of the rows' numbers that the fit leaves.

    From the residuals about `found`, not from the noise of the fit: one centre in a wrong optimum makes that large.
    """
    lengths = block.of_length
    squares = block.residual(found.state)[:, lengths] ** 2 / share - block.sigma[:, lengths] ** 2
    beyond = max(float(np.mean(squares)), 0.0) if squares.size else 0.0
    return float(min(np.exp(SPREAD**2) * np.sqrt(beyond), MOST_MM))


def _among_blocks(spacings: SpacingRows, found: Estimate, lines: Floats) -> Floats:
    """Variance (K,), mm², among the estimates of equal distances beyond their own; 0 for too few of them."""
    away = spacings.residual(found.state)[:, 0]
    own = np.einsum("kp,pq,kq->k", lines, found.covariance, lines)
    result = np.zeros(len(spacings))
    for given in np.unique(spacings.mm):
        mine = spacings.mm == given
        if np.count_nonzero(mine) >= BLOCKS_AT_LEAST and len(np.unique(spacings.pairs[mine])) == 2 * mine.sum():
            result[mine] = max(float(np.var(away[mine], ddof=1) - own[mine].mean()), 0.0)
    return result


FAR = 6.0
"""A distance contradicts the rows from this many standard deviations (certificate and prediction together)."""

LEAST_MM = 0.3
"""A smaller difference is no contradiction: the robot may bend that much, and the model is geometry alone."""


@final
@dataclass(frozen=True, eq=False)
class PredictedSpacings:
    """K distances, mm, as given and as estimated from rows alone; the covariance (K, K) of the estimates, mm², model
    errors included, and the σ (K,) of the given distances.
    """

    given: Floats
    estimate: Floats
    covariance: Floats
    sigma: Floats

    @classmethod
    def of(cls, spacings: SpacingRows, found: Estimate, errors: Floats) -> Self:
        """From a robot and points that were `found` without `spacings`; errors (K, K), mm²: `model_errors`."""
        state = found.state
        lines = spacings.jacobian(state)[:, 0]
        estimate = spacings.mm + spacings.residual(state)[:, 0]
        return cls(spacings.mm, estimate, lines @ found.covariance @ lines.T + errors, spacings.sigma[:, 0])

    @property
    def away(self) -> Floats:
        """Each given distance minus its estimate (K,), mm."""
        return self.given - self.estimate

    @property
    def spread(self) -> Floats:
        """The covariance (K, K) of `away`."""
        return np.asarray(self.covariance + np.diag(self.sigma**2))

    def scaled(self, factor: float) -> Self:
        """The same with the given distances times `factor`."""
        return replace(self, given=self.given * factor, sigma=self.sigma * factor)

    def contradicted(self) -> Bools:
        """Which distances (K,) contradict the rows alone."""
        return np.asarray(_ratio(self.away, np.sqrt(np.diag(self.spread))) > 1.0)

    def given_others(self, kept: Bools, one: int) -> tuple[float, float]:
        """Error of distance `one`, mm, given rows and the other `kept` ones (K,), and its 1 σ."""
        chosen = np.append(np.flatnonzero(kept & (np.arange(len(kept)) != one)), one)
        off, sigma = _off(np.linalg.inv(self.spread[np.ix_(chosen, chosen)]), self.away[chosen])
        return float(off[-1]), float(sigma[-1])


def wrong(predicted: PredictedSpacings) -> tuple[Bools, Bools]:
    """Which distances (K,) are wrong, and for which (K,) of these that is certain.

    Distances that are wrong by one factor agree with each other, so they are first compared with the rows alone.
    """
    contradicted = predicted.contradicted()
    certain = contradicted.copy()
    kept = np.flatnonzero(~contradicted)
    if kept.size:
        contradicted[kept], sure = _contradicting(predicted.away[kept], predicted.spread[np.ix_(kept, kept)])
        certain[kept] = contradicted[kept] & sure
    return contradicted, certain


def _contradicting(away: Floats, spread: Floats) -> tuple[Bools, bool]:
    """Which distances (K,) contradict the others and the rows, and whether it is certain that these are wrong."""
    weight: Floats = np.asarray(np.linalg.inv(spread), float)
    kept = np.ones(len(away), bool)
    if not (_ratio(*_off(weight, away)) > 1.0).any():
        return ~kept, True
    cures = np.array([not (_ratio(*_off(_without(weight, one), away)) > 1.0).any() for one in range(len(away))])
    if cures.any():
        return cures, int(np.count_nonzero(cures)) == 1
    while (ratio := _ratio(*_off(weight, away))).max() > 1.0:
        one = int(np.argmax(ratio))
        weight, kept[one] = _without(weight, one), False
    return ~kept, True


def _ratio(off: Floats, sigma: Floats) -> Floats:
    """Each error as a multiple of the accepted limit."""
    return np.asarray(np.abs(off) / np.maximum(FAR * sigma, LEAST_MM))


def _off(weight: Floats, away: Floats) -> tuple[Floats, Floats]:
    """Error of each (K,), given all others, and its 1 σ; `weight` (K, K): inverse covariance of `away`. For a distance
    that was taken out: 0 ± ∞.
    """
    own = np.diag(weight)
    there = own > 0.0
    variance = np.where(there, 1.0 / np.where(there, own, 1.0), np.inf)
    return np.where(there, weight @ away, 0.0) * np.where(there, variance, 0.0), np.sqrt(variance)


def _without(weight: Floats, one: int) -> Floats:
    """The inverse covariance without distance `one`, whose row and column are then 0."""
    result = weight - np.outer(weight[one], weight[one]) / weight[one, one]
    result[one], result[:, one] = 0.0, 0.0
    return np.asarray(result)
