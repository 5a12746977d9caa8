"""Cyclic search: compensation by predicted position errors alone, without a model of the robot.

Meng et al. 2024, doi 10.3390/app142411682, section 3.3. With f the nominal kinematics and ê the predicted error,

    P ← f(Q) + ê(Q);  P_step ← P_step + (P_target − P);  Q ← f⁻¹(P_step), the orientation held

until P is at the target. Read literally, the paper's loop subtracts the same step twice and never moves; this is what
its figure 12 means.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Bools, Floats, SerialChain, inverse

PredictedErrors: TypeAlias = Callable[[Floats], Floats]
"""Error of the TCP (N, 3), mm, actual − nominal, at model angles (N, n), rad: an error map's `errors`."""


@final
@dataclass(frozen=True, eq=False)
class Searched:
    """q (N, n): model angles, rad. predicted_mm (N,): predicted distance from the target there. rounds: their count.
    converged (N,): below the threshold.
    """

    q: Floats
    predicted_mm: Floats
    rounds: int
    converged: Bools


def cyclic_search(
    nominal: SerialChain,
    errors: PredictedErrors,
    targets: ArrayLike,
    start: ArrayLike,
    *,
    threshold_mm: float = 1e-3,
    rounds: int = 20,
) -> Searched:
    """Joints at which the TCP is predicted to be at the positions of `targets` (N, 4, 4), mm, from `start` (N, n), rad.

    The orientation is the nominal robot's at the target; its error is not compensated. A target that cannot be reached
    keeps its nearest posture, not converged. Joint limits are the caller's.
    """
    wanted = np.array(targets, float)
    step, places = wanted.copy(), wanted[:, :3, 3]
    found = inverse(nominal, wanted, start)
    for made in range(rounds + 1):
        left = places - nominal.forward(found.q)[:, :3, 3] - errors(found.q)
        away = np.linalg.norm(left, axis=1)
        if made == rounds or not (away[found.converged] > threshold_mm).any():
            break
        step[:, :3, 3] += left
        found = inverse(nominal, step, found.q)
    return Searched(found.q, np.asarray(away), made, np.asarray(found.converged & (away <= threshold_mm)))
