"""The estimator against SciPy's optimum of the same posterior by finite differences; noise and registration."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cellctl.calibration import (
    PoseRows,
    PositionRows,
    Split,
    State,
    Task,
    Tolerances,
    Unknowns,
    estimate,
    fit,
    identify,
    predict,
)
from cellctl.formats import nominal_model

INSTRUMENT = Rotation.from_euler("ZYX", [120, 5, -8], degrees=True)
PLACE = np.array([2100.0, -900.0, 40.0])
REFLECTOR = np.array([40.0, -60.0, 50.0])
"""From the true tool centre point to the reflector, along the flange's axes."""


def readings_of(rng, count):
    return rng.uniform([-90, -110, 40, -90, -80, -120], [90, -40, 120, 90, 80, 120], (count, 6))


@pytest.fixture(scope="module")
def poses(screw_robot):
    """120 poses of the screw robot in an instrument's frame, reflector 90 mm from where the tool was taught."""
    rng = np.random.default_rng(12)
    readings = readings_of(rng, 120)
    flanges = np.array([screw_robot.flange(row) for row in readings])
    reflector = screw_robot.tool + REFLECTOR
    points = flanges[:, :3, :3] @ reflector + flanges[:, :3, 3]
    xyz = INSTRUMENT.apply(points) + PLACE + rng.normal(0, 0.0173, (120, 3))
    turns = INSTRUMENT * Rotation.from_matrix(flanges[:, :3, :3]) * Rotation.from_euler("x", 20, degrees=True)
    turns = Rotation.from_rotvec(rng.normal(0, 1e-4, (120, 3))) * turns
    measured = np.tile(np.eye(4), (120, 1, 1))
    measured[:, :3, :3], measured[:, :3, 3] = turns.as_matrix(), xyz
    return readings, measured


@pytest.fixture(scope="module")
def position_task(kr5, poses):
    readings, measured = poses
    rows = PositionRows(kr5.joint_map().model(readings), measured[:, :3, 3], np.full((120, 3), 0.0173))
    return Task(nominal_model(kr5, touched=False), rows)


def test_positions_identify_the_robot_whatever_stands_between_it_and_the_instrument(position_task):
    found = fit(position_task, Split.by_column(np.arange(120) >= 70))
    assert found.nominal.mean > 0.5
    assert found.test.mean < 0.05
    assert found.verdict == "better"
    assert found.coverage_95 > 0.85
    assert "θ1 with base rotation about Z" in found.observability.unseen


def test_nominal_has_base_and_tool_registered_as_well_as_they_can_be(position_task):
    """An optimiser of its own, over base and reflector alone, finds no better registration."""
    found = identify(position_task).nominal
    chain, rows = position_task.model.chain, position_task.rows.only
    flange = chain.with_base(np.eye(4)).forward_flange(rows.q)

    def residual(x):
        points = flange[:, :3, :3] @ x[6:] + flange[:, :3, 3]
        return ((Rotation.from_rotvec(x[:3]) * INSTRUMENT).apply(points) + x[3:6] - rows.xyz).ravel()

    best = least_squares(residual, np.r_[np.zeros(3), PLACE, 0, 0, 400.0], x_scale="jac")
    own = rows.residual(found.state)
    assert np.sum(own**2) == pytest.approx(np.sum(best.fun**2), rel=1e-6)


def test_the_optimum_is_scipys_optimum_of_the_same_posterior(position_task):
    found = identify(position_task).identified
    unknowns, noise = found.unknowns, identify(position_task).noise
    free = np.flatnonzero(unknowns.free)
    rows = position_task.rows.noisier(noise).only

    def residual(scaled):
        deviations = np.zeros(len(unknowns.names))
        deviations[free] = scaled * unknowns.sigma[free]
        return np.concatenate([(rows.residual(unknowns.state(deviations)) / rows.sigma).ravel(), scaled])

    best = least_squares(residual, np.zeros(free.size), jac="3-point", x_scale="jac", xtol=1e-15, ftol=1e-15)
    assert found.cost == pytest.approx(2 * best.cost, rel=1e-6)
    sigma = np.sqrt(np.diag(found.covariance))[free]
    difference = (found.deviations[free] - best.x * unknowns.sigma[free]) / sigma
    assert np.abs(difference).max() < 0.01
    numeric = np.linalg.inv(best.jac.T @ best.jac) * np.outer(unknowns.sigma[free], unknowns.sigma[free])
    np.testing.assert_allclose(np.sqrt(np.diag(numeric)), sigma, rtol=1e-3)


def test_poses_identify_orientation_as_well(kr5, poses):
    readings, measured = poses
    sigma = np.hstack([np.full((120, 3), 0.0173), np.full((120, 3), 1e-4)])
    task = Task(nominal_model(kr5, touched=False), PoseRows(kr5.joint_map().model(readings), measured, sigma))
    found = fit(task, Split.by_column(np.arange(120) >= 70))
    turn = task.rows.only.pick(np.arange(70, 120)).residual(found.identification.identified.state)[:, 3:]
    assert found.test.mean < 0.06
    assert np.degrees(np.linalg.norm(turn, axis=1).mean()) < 0.03


def test_residuals_larger_than_said_raise_the_noise_and_the_sigmas_with_it(position_task):
    honest = identify(position_task)
    boastful = identify(replace(position_task, rows=position_task.rows.noisier(np.full(3, 0.1))))
    np.testing.assert_allclose(boastful.noise, 10.0 * honest.noise, rtol=0.1)
    np.testing.assert_allclose(
        np.sqrt(np.diag(boastful.identified.covariance)), np.sqrt(np.diag(honest.identified.covariance)), rtol=0.15
    )


def test_predicted_sigma_covers_the_error_at_new_joints(position_task, screw_robot, kr5):
    state = identify(position_task).identified
    readings = readings_of(np.random.default_rng(77), 100)
    said = predict(state.state.model, state.covariance[: state.unknowns.robot, : state.unknowns.robot],
                   kr5.joint_map().model(readings))  # fmt: skip
    flanges = np.array([screw_robot.flange(row) for row in readings])
    points = flanges[:, :3, :3] @ (screw_robot.tool + REFLECTOR) + flanges[:, :3, 3]
    error = np.linalg.norm(said.poses[:, :3, 3] - INSTRUMENT.apply(points) - PLACE, axis=1)
    assert 0.5 < np.sqrt(np.mean(error**2)) / np.sqrt(np.mean(said.sigma_mm**2)) < 2.0


def test_rows_that_contradict_every_robot_do_not_look_good(position_task):
    rows = position_task.rows.only
    shuffled = replace(rows, xyz=np.random.default_rng(0).permutation(rows.xyz))
    found = fit(replace(position_task, rows=shuffled), Split.by_column(np.arange(120) >= 70))
    assert found.test.mean > 100.0


def test_rows_all_alike_see_next_to_nothing_and_stay_finite(position_task):
    rows = position_task.rows.only.pick(np.zeros(20, int))
    found = fit(replace(position_task, rows=rows), Split.by_column(np.arange(20) >= 10))
    assert found.observability.rank <= 3
    assert np.isfinite(found.identification.identified.covariance).all()
    assert found.verdict == "no better"


def test_a_step_by_singular_values_leaves_the_solution_where_it_is_and_has_its_covariance(position_task):
    """The estimator folds rows into triangles by QR; here the same equations are solved whole, by SVD."""
    found = identify(position_task)
    fitted, noisy = found.identified, position_task.rows.noisier(found.noise).only
    free, scale = np.flatnonzero(fitted.unknowns.free), fitted.unknowns.sigma[fitted.unknowns.free]
    lines = noisy.jacobian(fitted.state)[..., free] * scale / noisy.sigma[..., None]
    pins = np.zeros((0, free.size)) if fitted.unknowns.pinned is None else fitted.unknowns.pinned[:, free]
    assert not len(pins)
    whole = np.vstack([lines.reshape(-1, free.size), np.eye(free.size)])
    right = np.concatenate([(noisy.residual(fitted.state) / noisy.sigma).ravel(), fitted.deviations[free] / scale])
    left, singular, turned = np.linalg.svd(whole, full_matrices=False)
    covariance = (turned.T / singular**2) @ turned
    sigma = np.sqrt(np.diag(covariance))
    assert singular[0] > 1e4 * singular[-1]
    assert np.abs(turned.T @ (left.T @ right / singular) / sigma).max() < 1e-4
    posterior = fitted.covariance[np.ix_(free, free)] / np.outer(scale, scale)
    np.testing.assert_allclose(posterior / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=1e-6)


@dataclass(frozen=True)
class LinearRows:
    """Rows A x − b of the parameters' deviations x, of 1 σ each."""

    lines: np.ndarray
    right: np.ndarray
    quantities = ("position",)

    @property
    def sigma(self):
        return np.ones((len(self.right), 1))

    def residual(self, state):
        return (self.lines @ state.model.deviations - self.right)[:, None]

    def jacobian(self, state):
        return self.lines[:, None, :]

    def __len__(self):
        return len(self.right)


def test_linear_rows_whose_parameters_are_seen_a_million_times_better_one_than_another_are_solved_in_one_step(kr5):
    rng, model = np.random.default_rng(3), nominal_model(kr5, touched=False)
    unknowns = Unknowns.of(State.alone(model), (), Tolerances())
    count = len(unknowns.names)
    left, _ = np.linalg.qr(rng.normal(size=(200, count)))
    right, _ = np.linalg.qr(rng.normal(size=(count, count)))
    lines = left * np.geomspace(1e6, 1.0, count) @ right.T / unknowns.sigma
    rows = LinearRows(lines, lines @ (unknowns.sigma * rng.normal(size=count)) + rng.normal(size=200))
    found = estimate(unknowns, [rows])
    whole = np.vstack([lines * unknowns.sigma, np.eye(count)])
    best = np.linalg.lstsq(whole, np.concatenate([rows.right, np.zeros(count)]), rcond=None)[0]  # by SVD
    sigma = np.sqrt(np.diag(found.covariance))
    assert found.iterations == 2  # the second one finds that nothing is left to gain
    assert found.converged
    np.testing.assert_allclose(found.deviations / sigma, best * unknowns.sigma / sigma, atol=1e-6)
