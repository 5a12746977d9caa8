"""Errors of predicted distances from what the model lacks: σ of a fit takes the remaining scatter of its rows as noise.

Noise averages out over the visits of a point, a smooth error of the robot does not: visits at similar joints share it.
So the scatter of the residuals beyond the stated σ is taken as such an error δ(q), a Gaussian process on each axis, and
carried through the fit. With the gain G = −L C Jᵀ of the fit (L: distances by the parameters, C: their covariance, J:
rows by the parameters, in standard deviations) and A the rows by a shift of the TCP, a distance errs by G A δ, and

    cov = (G A) K (G A)ᵀ,  K_ij = s_i s_j exp(−‖q_i − q_j‖²/2l²)

A Panda's spacing of 50 mm was refused without it: 49.36 ± 0.08 mm at one place of the plate, 49.9 at the others.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.rows import Measured, SpacingRows
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Floats

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
    share = max(1.0 - found.seen_by_data / max(rows.size, 1), 1.0 / max(rows.size, 1))
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
