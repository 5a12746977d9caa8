"""Changes of joint zeros since a prior model was made, and their uncertainty.

A zero's change is more precise than the zero: the prior model's error (a turn of the base may be confused with one
of joint 1) is in both, and cancels.
"""

from __future__ import annotations

import numpy as np

from cellctl.calibration.estimation.estimate import Estimate
from cellctl.calibration.estimation.task import Task
from cellctl.kinematics import Floats


def zero_changes(task: Task, found: Estimate) -> tuple[Floats, Floats]:
    """Change of each joint's zero (n,) from `task.model` to `found`, and its 1 σ (n,), rad.

    With the errors e of the prior model the new zeros are wrong by A e_held + noise, their change by A e_held −
    e_zeros + noise; Σ_new holds A Σ_held Aᵀ + noise, and A Σ_held beside it.
    """
    parameters = found.state.model.parameters
    zeros = np.flatnonzero([parameter.group == "zeros" for parameter in parameters])
    change = found.state.model.deviations[zeros] - task.model.deviations[zeros]
    covariance = found.covariance[np.ix_(zeros, zeros)]
    if task.prior is not None:
        held = np.flatnonzero(~found.unknowns.free[: len(parameters)] & (np.diag(task.prior) > 0.0))
        beside = found.covariance[np.ix_(zeros, held)]
        shared = beside @ _inverse(task.prior[np.ix_(held, held)]) @ task.prior[np.ix_(held, zeros)]
        covariance = covariance + task.prior[np.ix_(zeros, zeros)] - shared - shared.T
    return change, np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _inverse(covariance: Floats) -> Floats:
    """Inverse (H, H) of a covariance in mixed units; combinations known exactly have none, and get weight 0."""
    scales = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    return np.asarray(np.linalg.pinv(covariance / scales, rcond=1e-12, hermitian=True) / scales)
