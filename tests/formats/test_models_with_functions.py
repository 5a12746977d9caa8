"""Model files with harmonics and a discrepancy: the same robot, region and σ after a file; σ outside is larger."""

import json

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from cellctl.calibration import Split, fit, predict
from cellctl.files import InputError
from cellctl.formats import DataSet, ModelFile, RobotFile, measurements
from cellctl.formats.fit_report import wide
from tests.helpers import arms
from tests.helpers.arms import csv_text, joints_and_places

ROBOT = RobotFile.model_validate(yaml.safe_load(arms.ELBOW_ROBOT))
LOW, HIGH = arms.ELBOW_LOWER, arms.ELBOW_UPPER


def tip(readings):
    """Where the arm's tip is (N, 3), mm: its links are off, and it leans by up to 0.3 mm as no link of a table can."""
    turn, shoulder, elbow = np.radians(readings).T
    lean = np.stack([np.sin(2.0 * turn + shoulder), np.cos(turn * elbow), np.sin(turn * shoulder)], axis=1)
    return arms.ElbowArm().tcp(readings) + 0.3 * lean


def measured_and_fitted(terms):
    """Measurements of 90 rows, and their fit: 70 rows to fit, 20 held out."""
    rng = np.random.default_rng(6)
    readings = rng.uniform(LOW, HIGH, (90, 3))
    text = csv_text(joints_and_places(readings, tip(readings) + rng.normal(0.0, 0.017, (90, 3))))
    measured = measurements(ROBOT, DataSet.parse(text, "data.csv"), model=terms)
    return measured, fit(measured.task, Split.by_column(np.arange(90) >= 70))


@pytest.fixture(scope="module")
def fitted():
    return measured_and_fitted("geometry")


@pytest.fixture(scope="module")
def model(fitted):
    return ModelFile.of(ROBOT, *fitted)


@pytest.mark.long
def test_harmonics_and_a_discrepancy_come_back_from_a_file_as_they_were_fitted(tmp_path):
    fitted = measured_and_fitted("geometry+harmonics")
    model = ModelFile.of(ROBOT, *fitted)
    model.save(tmp_path / "model.json")
    again = ModelFile.load(tmp_path / "model.json")
    assert again == model
    found = fitted[1].identification.identified
    robot, count = again.robot_model(), found.unknowns.robot
    assert [effect.group for effect in robot.effects] == ["harmonics", "discrepancy"]
    assert again.model == "geometry+harmonics+discrepancy"
    readings = np.random.default_rng(2).uniform(LOW, HIGH, (50, 3))
    q = ROBOT.joint_map().model(readings)
    own = predict(found.state.model, found.covariance[:count, :count], q)
    assert_allclose(robot.tcp(q), own.poses[:, :3, 3], atol=1e-9)
    outside = fitted[1].region.sigma(q)
    assert_allclose(again.predict(readings).sigma_mm, np.hypot(own.sigma_mm, outside), rtol=1e-9)
    assert outside.max() > 0.0


def test_coefficients_of_a_random_function_are_not_named_as_parameters_far_from_the_robot_file(fitted):
    result = fitted[1]
    found = result.identification.identified
    coefficients = found.deviations[np.array(found.unknowns.groups) == "discrepancy"]
    assert np.abs(coefficients).max() > 3.0 * 0.1
    assert wide(result) == []


def test_outside_the_measured_region_sigma_is_larger_and_is_that_of_the_errors_there(model):
    rng = np.random.default_rng(1)
    inside, anywhere = rng.uniform(LOW, HIGH, (200, 3)), rng.uniform(-180.0, 180.0, (400, 3))
    outside = anywhere[~model.inside(anywhere)]
    near, far = model.predict(inside), model.predict(outside)
    assert np.median(far.sigma_mm) > 5.0 * np.median(near.sigma_mm)
    # Outside it is the upper 90 % point of what the ends of the joint ranges show: above the errors in most draws.
    for readings, said, least in ((inside, near, 0.5), (outside, far, 0.3)):
        error = np.linalg.norm(said.poses[:, :3, 3] - tip(readings), axis=1)
        assert least < np.sqrt(np.mean(error**2) / np.mean(said.sigma_mm**2)) < 1.2


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda content: content["effects"][0]["centres"][0].pop(), "discrepancy"),
        (lambda content: [row.pop() for row in content["effects"][0]["centres"]], "discrepancy"),
        (lambda content: content["effects"][0].update(length=0.0), "length"),
        (lambda content: content["effects"][0].update(centres=[]), "centres"),
        (lambda content: [row.pop() for row in content["joint_region"]["postures"]], "joint region"),
        (lambda content: content["joint_region"]["postures"][0].pop(), "joint region"),
        (lambda content: content["joint_region"].update(length=-1.0), "length"),
    ],
)
def test_postures_that_are_not_this_robots_are_refused_in_words(model, tmp_path, change, words):
    content = json.loads(model.text())
    change(content)
    (tmp_path / "model.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match=words):
        ModelFile.load(tmp_path / "model.json")
