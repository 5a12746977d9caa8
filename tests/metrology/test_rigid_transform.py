"""A rigid transform by generalised least squares, against scipy's minimiser of the same weighted squares."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cellctl.kinematics import pose_from_xyz_abc
from cellctl.metrology.measured_pose import rigid_transform

POINTS = np.array([[0.0, 0.0, 0.0], [400.0, 0.0, 0.0], [0.0, 300.0, 0.0], [200.0, 150.0, 250.0]])
PLACE = pose_from_xyz_abc([2500.0, -600.0, 300.0], [40.0, -20.0, 75.0])
SCATTER_MM = np.repeat([3.0, 0.06, 0.3, 4.5], 3)


def correlated_points(seed):
    """Measured points, and their correlated covariance; the worst point scatters 75 times as much as the best."""
    rng = np.random.default_rng(seed)
    mixed = SCATTER_MM[:, None] * rng.normal(size=(12, 12))
    covariance = mixed @ mixed.T / 12.0 + 1e-6 * np.eye(12)
    noise = np.linalg.cholesky(covariance) @ rng.normal(size=12)
    return POINTS @ PLACE[:3, :3].T + PLACE[:3, 3] + noise.reshape(-1, 3), covariance


def minimised(measured, covariance):
    """Rotation, position, chi2 and covariance (6, 6) by scipy; the second search begins at the first one's end.

    There the parameters are zero, so that their covariance is of a slide and a turn about the outer frame's axes.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    turn, place = PLACE[:3, :3], PLACE[:3, 3]
    for _ in range(2):

        def residual(change, turn=turn, place=place):
            turned = Rotation.from_rotvec(change[3:]).as_matrix() @ turn
            return whiten @ (POINTS @ turned.T + place + change[:3] - measured).ravel()

        found = least_squares(residual, np.zeros(6), jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
        turn, place = Rotation.from_rotvec(found.x[3:]).as_matrix() @ turn, place + found.x[:3]
    return turn, place, 2.0 * found.cost, np.linalg.inv(found.jac.T @ found.jac)


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_points_of_unequal_correlated_covariance_are_carried_to_the_least_weighted_squares(seed):
    measured, covariance = correlated_points(seed)
    turn, place, chi2, uncertainty = minimised(measured, covariance)
    fit = rigid_transform(POINTS, measured, covariance)
    assert fit.chi2 == pytest.approx(chi2, rel=1e-9)
    assert np.abs(fit.pose.matrix[:3, 3] - place).max() < 1e-5
    assert np.abs(fit.pose.matrix[:3, :3] - turn).max() < 1e-7
    assert np.allclose(fit.pose.covariance, uncertainty, rtol=1e-4, atol=1e-4 * np.abs(uncertainty).min())
    assert fit.dof == 6
    residual = POINTS @ turn.T + place - measured
    assert np.abs(fit.residual - residual).max() < 1e-5
