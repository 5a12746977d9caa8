"""The field as a step of `auto`: kept where held-out rows gain, estimated with the links, in the model file."""

from functools import cache

import numpy as np
import pytest
import yaml

from cellctl.calibration import JointField, Split, fit, predict
from cellctl.calibration.effects import EffectInputs
from cellctl.calibration.identification.ladder import remainder
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import Remainder
from cellctl.formats import DataSet, ModelFile, RobotFile, measurements
from tests.helpers import arms
from tests.helpers.arms import csv_text, joints_and_places

ROBOT = RobotFile.model_validate(yaml.safe_load(arms.ELBOW_ROBOT))
FIT, HELD_OUT = 120, 100
SIGMA = 0.017


def lean(readings):
    """An error (N, 3), mm, that no link and no effect has: x changes with turn and shoulder, z with the elbow alone."""
    turn, shoulder, elbow = np.radians(readings).T
    return np.stack(
        [0.3 * np.sin(2.0 * turn) * np.cos(3.0 * shoulder), 0.0 * turn, 0.2 * np.cos(3.0 * elbow + turn)], 1
    )


@cache
def fitted(size, model="auto", seed=6, outlier=None):
    """Measurements and fit of an arm that leans so many times as `lean` says; row `outlier` is 80 mm off."""
    rng = np.random.default_rng(seed)
    readings = rng.uniform(arms.ELBOW_LOWER, arms.ELBOW_UPPER, (FIT + HELD_OUT, 3))
    places = arms.ElbowArm().tcp(readings) + size * lean(readings) + rng.normal(0.0, SIGMA, (len(readings), 3))
    if outlier is not None:
        places[outlier] += (0.0, 80.0, 0.0)
    measured = measurements(
        ROBOT, DataSet.parse(csv_text(joints_and_places(readings, places)), "data.csv"), model=model
    )
    return measured, fit(measured.task, Split.by_column(np.arange(len(readings)) >= FIT))


@pytest.mark.long
def test_auto_keeps_the_field_where_held_out_rows_gain_and_its_sigma_is_right():
    _, result = fitted(1.0)
    assert result.model.split("+")[-1] == "field"
    assert [step.kept for step in result.ladder if step.model.endswith("+field")] == [True]
    _, without = fitted(1.0, "geometry")
    assert without.model == "geometry+discrepancy"
    assert result.test.rms < 0.8 * without.test.rms
    assert result.predicted_test_rms == pytest.approx(result.test.rms, rel=0.2)
    assert 0.92 <= result.coverage_95 <= 0.99


def test_auto_does_not_try_the_field_where_nothing_is_missing():
    _, result = fitted(0.0)
    assert not any("field" in step.model for step in result.ladder)


def test_the_links_are_identified_beside_the_field_not_before_it():
    _, result = fitted(1.0)
    found = result.identification.identified
    place = found.unknowns.names.index("a2")
    sigma = np.sqrt(found.covariance[place, place])
    assert found.deviations[place] == pytest.approx(arms.ElbowArm().upper - 500.0, abs=3.0 * sigma)


def test_a_model_file_holds_the_field_and_predicts_the_same(tmp_path):
    measured, result = fitted(1.0)
    ModelFile.of(ROBOT, measured, result).save(tmp_path / "model.json")
    again = ModelFile.load(tmp_path / "model.json").robot_model()
    found = result.identification.identified
    q = ROBOT.joint_map().model(np.random.default_rng(2).uniform(arms.ELBOW_LOWER, arms.ELBOW_UPPER, (50, 3)))
    own = predict(found.state.model, found.covariance[: found.unknowns.robot, : found.unknowns.robot], q)
    np.testing.assert_allclose(again.tcp(q), own.poses[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(again.open_variance(q), found.state.model.open_variance(q), atol=1e-12)


def left_by(errors, q, variance=0.0):
    return Remainder(q, errors, variance * np.ones((3, len(q), len(q))))


def some(count=120, seed=3):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1.5, 1.5, (count, 4))
    errors = np.stack([0.2 * np.sin(2.0 * q[:, 0]), 0.1 * np.cos(2.0 * q[:, 1]), np.zeros(count)], axis=1)
    return q, errors + 0.01 * rng.standard_normal((count, 3))


def field_over(q):
    return JointField.of_inputs(EffectInputs(None, Postures(q)))


def test_a_joint_without_influence_on_an_axis_has_a_far_longer_length():
    q, errors = some()
    lengths = field_over(q).fitted_to(left_by(errors, q)).lengths
    assert lengths[0, 0] < 0.4 * lengths[0, 1:].min()
    assert lengths[1, 1] < 0.4 * np.delete(lengths[1], 1).min()


def test_noise_alone_makes_no_field():
    q, _ = some()
    noise = 0.01 * np.random.default_rng(5).standard_normal((len(q), 3))
    assert field_over(q).fitted_to(left_by(noise, q)) is None


def test_what_other_terms_may_still_explain_makes_no_field():
    q, _ = some()
    noise = 0.01 * np.random.default_rng(5).standard_normal((len(q), 3))
    assert field_over(q).fitted_to(left_by(noise + 5.0, q, variance=100.0)) is None


def test_ten_rows_make_no_field():
    q, errors = some(10)
    assert field_over(q) is None
    assert field_over(some()[0]).fitted_to(left_by(errors, q)) is None


def test_repeated_postures_and_a_joint_that_never_moved_make_a_sound_field():
    q, errors = some(60)
    q[:, 3] = 0.4
    field = field_over(q).fitted_to(left_by(np.tile(errors, (2, 1)), np.tile(q, (2, 1))))
    assert np.isfinite(field.lengths).all()
    assert len(np.unique(field.centres, axis=0)) == len(field.centres)


def test_far_from_the_rows_its_whole_size_is_open():
    q, errors = some()
    field = field_over(q).fitted_to(left_by(errors, q))
    size = np.mean(np.square(field.expected))
    assert field.variance(ROBOT.chain(), Postures(np.full((1, 4), 1e3)))[0] == pytest.approx(size)
    assert field.variance(ROBOT.chain(), Postures(q)).mean() < 0.02 * size


@pytest.mark.parametrize(
    ("shifts", "of_instrument", "points"),
    [
        (np.ones((5, 1, 3)), [False] * 5, 0),  # touches
        (np.tile(np.eye(3), (5, 1, 1)), [False] * 5, 0),  # sockets
        (np.tile(np.eye(3), (5, 1, 1)), [True] * 3 + [False] * 2, 3),
    ],
)
def test_only_points_that_an_instrument_measured_show_a_field(shifts, of_instrument, points):
    from types import SimpleNamespace

    rows = SimpleNamespace(q=np.zeros((5, 4)), of_instrument=np.array(of_instrument))
    linear = SimpleNamespace(residual=np.zeros(shifts.shape[:2]), jacobian=np.zeros((*shifts.shape[:2], 2)))
    left = remainder(rows, linear, [0, 1], (np.eye(2), np.zeros(2)), shifts)
    assert len(left.q) == points


@pytest.mark.parametrize(
    ("lengths", "expected", "message"),
    [
        (np.ones((2, 4)), (0.1, 0.1, 0.1), "three rows of lengths"),
        (np.ones((3, 3)), (0.1, 0.1, 0.1), "three rows of lengths"),
        (np.ones((3, 4)), (0.1, 0.1), "three expected sizes"),
        (np.zeros((3, 4)), (0.1, 0.1, 0.1), "above 0"),
    ],
)
def test_a_field_of_wrong_shape_is_refused(lengths, expected, message):
    with pytest.raises(ValueError, match=message):
        JointField(np.zeros((1, 4)), lengths, expected)


@pytest.mark.long
def test_a_far_outlier_is_left_out_and_changes_the_field_hardly():
    _, clean = fitted(1.0)
    _, result = fitted(1.0, outlier=17)
    assert result.identification.outliers == (17,)
    assert result.model == clean.model
    assert result.test.rms < 1.1 * clean.test.rms
