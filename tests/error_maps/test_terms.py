"""Error maps as terms of a model: learnt after the geometry, in each fold anew, stored, predicted, compensated."""

import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose

from cellctl.calibration import Postures, RobotModel, Split, fit
from cellctl.calibration.model.learnt_map import Residuals, learnt_maps
from cellctl.compensation import compensate
from cellctl.compensation.online import online_arrays
from cellctl.error_maps.terms import KrigingTerm
from cellctl.files import InputError
from cellctl.formats import DataSet, ModelFile, RobotFile, from_prior, measurements
from cellctl.formats.measurements import ModelTerms
from cellctl.operations.predicting import predict_rows
from tests.helpers import arms
from tests.helpers.arms import csv_text, drawn, joints_and_places

ROBOT = RobotFile.model_validate(yaml.safe_load(arms.ELBOW_ROBOT))
FIT, HELD_OUT, SIGMA = 120, 100, 0.012
FLEXIBILITY = np.array([2e-4, 4e-4, 3e-4])


def lean(readings):
    """An error (N, 3), mm, that no link and no effect has."""
    turn, shoulder, elbow = np.radians(readings).T
    return np.stack(
        [0.3 * np.sin(2.0 * turn) * np.cos(3.0 * shoulder), 0.0 * turn, 0.2 * np.cos(3.0 * elbow + turn)], 1
    )


def currents_at(readings, rng):
    """Motor currents (N, 3), A, in the joints' sense: the arm's weight, and friction by the sense of motion."""
    _, shoulder, elbow = np.radians(readings).T
    weight = np.stack([0.0 * elbow, 4.0 * np.cos(shoulder) + 2.0 * np.cos(elbow), 2.0 * np.cos(elbow)], 1)
    return weight + 0.05 * rng.choice([-1.0, 1.0], weight.shape)


@cache
def rows(kind="lean"):
    """Readings (N, 3), places (N, 3), mm, and columns of a data set, of an arm that leans, or whose joints lag."""
    rng = np.random.default_rng(4)
    readings = drawn(rng, FIT + HELD_OUT)
    if kind == "lean":
        places, columns = arms.ElbowArm().tcp(readings) + lean(readings), {}
    else:
        currents = currents_at(readings, rng)
        signs = np.array([row.sign for row in ROBOT.joints])
        turned = readings - signs * np.degrees(FLEXIBILITY * currents)
        places, columns = arms.ElbowArm().tcp(turned), {f"I{j + 1}": signs[j] * currents[:, j] for j in range(3)}
    places = places + rng.normal(0.0, SIGMA, places.shape)
    return readings, places, columns


def read(model, kind="lean", spoilt=0.0):
    readings, places, columns = rows(kind)
    places = places + np.where(np.arange(len(places)) < FIT, 0.0, spoilt)[:, None]
    text = csv_text({**joints_and_places(readings, places), **columns})
    return measurements(ROBOT, DataSet.parse(text, "data.csv"), model=model)


@cache
def fitted(model, kind="lean", spoilt=0.0):
    found = read(model, kind, spoilt)
    held_out = np.arange(len(found.lines)) >= FIT
    return found, fit(found.task, Split.by_column(held_out))


def file_of(model, kind="lean"):
    found, result = fitted(model, kind)
    return ModelFile.of(found.robot, found, result)


MAPS = [
    "kriging",
    "kriging:space=position",
    "kriging:space=pose",
    "idw",
    "idw:space=joints",
    "perceptron:layers=16,alpha=0.1",
    "network",
]


@pytest.mark.long
@pytest.mark.parametrize("term", MAPS)
def test_a_map_predicts_what_the_geometry_leaves(term):
    found, result = fitted(f"geometry+{term}")
    alone = found.task.rows.errors(result.identification.without_maps.identified.state)[FIT:]
    assert result.model == f"geometry+{term.partition(':')[0]}"
    assert result.test.rms < 0.6 * np.sqrt(np.mean(alone**2))
    assert result.verdict == "better"


@pytest.mark.long
def test_kriging_states_a_sigma_and_the_others_none():
    _, kriging = fitted("geometry+kriging")
    assert kriging.coverage_95 > 0.88
    assert kriging.sigma_ok
    _, other = fitted("geometry+idw")
    summary = other.summary()
    assert [summary[key] for key in ("predicted_test_rms", "coverage_95", "predicted_volumetric_rms")] == [None] * 3
    assert (other.sigma_ok, other.sigma_reason) == (None, "the model states no σ")


@pytest.mark.long
def test_far_from_the_rows_the_sigma_of_kriging_is_the_size_of_the_errors():
    model = file_of("geometry+kriging").robot_model()
    near, far = Postures(ROBOT.joint_map().model(rows()[0])), Postures(np.full((1, 3), 50.0))
    [term] = learnt_maps(model)
    scatter = term.of_errors[1] * np.array(term.inflation)
    assert model.open_variance(far)[0] == pytest.approx(np.mean(scatter**2 + np.array(term.constant) ** 2))
    assert model.open_variance(near).mean() < 0.2 * model.open_variance(far)[0]


@pytest.mark.long
@pytest.mark.parametrize("term", ["kriging", "idw", "perceptron:layers=16,alpha=0.1", "network"])
def test_the_model_file_has_the_map(term, tmp_path):
    model = file_of(f"geometry+{term}")
    model.save(tmp_path / "model.json")
    stored, readings = ModelFile.load(tmp_path / "model.json"), rows()[0]
    assert stored.text() == model.text()
    found, result = fitted(f"geometry+{term}")
    q = found.robot.joint_map().model(readings)
    assert_allclose(stored.robot_model().tcp(q), result.identification.identified.state.model.tcp(q), atol=1e-9)


@pytest.mark.long
def test_rows_that_judge_have_no_influence():
    _, one = fitted("geometry+kriging")
    _, other = fitted("geometry+kriging", spoilt=5.0)
    [mine], [theirs] = (learnt_maps(each.identification.identified.state.model) for each in (one, other))
    assert_allclose(mine.pulls, theirs.pulls)
    assert other.test.mean > 5.0


@pytest.mark.long
def test_each_fold_learns_its_own_map():
    found = read("geometry+kriging:weights=equal")
    by_folds = fit(found.task, Split.folds(len(found.lines), 4, 0))
    assert by_folds.test.rms > 2.0 * by_folds.fit.rms  # a map that had seen the fold would leave what it leaves there


def test_a_prediction_says_none_where_there_is_no_sigma():
    data = DataSet.parse(csv_text({f"A{j + 1}": rows()[0][:5, j] for j in range(3)}), "joints.csv")
    of_kriging = predict_rows(file_of("geometry+kriging"), data).records()
    of_distance = predict_rows(file_of("geometry+idw"), data).records()
    assert all(0.0 < row["sigma"] < 1.0 for row in of_kriging)
    assert all(row["sigma"] is None for row in of_distance)


@pytest.mark.parametrize("method", ["cyclic-search", "pseudo-target", "pseudo-target-matrix", "newton-raphson"])
def test_targets_are_compensated_with_the_map(method, measured):
    q, errors = measured(150, 1)
    controller = RobotFile.load(arms.KR5_FILE).chain()
    left = Residuals(RobotModel(controller), Postures(q), errors, np.full(errors.shape, 1e-4))
    model = RobotModel(controller, (KrigingTerm.of_options("weights=equal", 6).learnt(left),))
    at, true = measured(40, 2)
    targets = controller.forward(at)
    found = compensate(controller, model, targets, at, method=method)
    assert found.converged.all()
    assert found.predicted_after_mm.max() < 1e-5
    left_over = model.tcp(at) - controller.forward(at)[:, :3, 3] - true
    assert np.linalg.norm(left_over, axis=1).mean() < 0.3 * np.linalg.norm(true, axis=1).mean()


@pytest.mark.parametrize("term", ["kriging", "network"])
def test_on_line_correction_names_what_it_cannot_compute(term):
    model = file_of(f"geometry+{term}").robot_model()
    with pytest.raises(ValueError, match=f"the model's {term} cannot be computed on-line"):
        online_arrays(model, ROBOT.joint_map(), arms.ELBOW_LOWER, arms.ELBOW_UPPER, 5.0)


def test_poe_is_the_same_geometry():
    _, links = fitted("geometry")
    found, axes = fitted("poe")
    assert found.robot.convention == "poe"
    assert axes.test.rms == pytest.approx(links.test.rms, rel=0.05)


@pytest.mark.long
def test_a_network_takes_the_place_of_the_currents():
    file = file_of("geometry+motor+network", "lag")
    readings, places, columns = rows("lag")
    q = file.robot.joint_map().model(readings)
    model = file.robot_model()
    signs = np.array([row.sign for row in ROBOT.joints])
    currents = signs * np.stack([columns[f"I{j}"] for j in range(1, 4)], 1)
    assert_allclose(model.tcp(q), model.tcp(Postures(q, currents=currents)), atol=1e-9)
    bare = replace(model, effects=model.effects[:-1])
    left, without = (np.linalg.norm(each.tcp(q) - places, axis=1)[FIT:].mean() for each in (model, bare))
    # weight is a function of the joints, friction is not: between the currents themselves and nothing
    assert fitted("geometry+motor", "lag")[1].test.mean < left < 0.3 * without


def test_a_map_of_a_prior_model_stays():
    prior = file_of("geometry+kriging")
    readings, places, _ = rows()
    few = DataSet.parse(csv_text(joints_and_places(readings[:20], places[:20] + np.array([40.0, 0.0, 0.0]))), "few.csv")
    task = from_prior(measurements(ROBOT, few), prior, ("base",), "model.json")
    result = fit(task.task, Split.folds(20, 4, 0))
    [before], [after] = learnt_maps(prior.robot_model()), learnt_maps(result.identification.identified.state.model)
    assert_allclose(after.pulls, before.pulls)
    assert result.test.mean < 0.1


BAD = {
    "kriging:lambda=much": "kriging: lambda=much: give rows, or a number from 1e-09 to 1",
    "kriging:length=3": "kriging: it has no setting 'length', but space, semivariogram, lambda, weights, particles, "
    "rounds, seed",
    "kriging:lambda": "kriging: 'lambda': write each setting once, as KEY=VALUE",
    "kriging:seed=1,seed=2": "kriging: 'seed=2': write each setting once, as KEY=VALUE",
    "kriging:weights=initial": "kriging: weights=initial: the paper has them for six joints; give equal or searched",
    "geometry+perceptron:layers=0": "perceptron: layers=0: give rows, or units of one to four layers, as 16 or 32-16",
    "compliance:a=1": "compliance: it has no settings",
    "geometry+poe": "'geometry+poe': name one of geometry, poe, zeros: geometry holds the zeros",
}


@pytest.mark.parametrize("model", BAD)
def test_settings_that_do_not_exist_are_refused(model):
    with pytest.raises(InputError) as caught:
        ModelTerms.parse(model, 3)
    assert caught.value.problems[0].what == BAD[model]


def test_without_scikit_learn_the_message_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.neural_network", None)
    with pytest.raises(InputError, match=r"pip install 'cellctl\[baselines\]'"):
        ModelTerms.parse("geometry+network")


def test_with_fewer_rows_than_make_a_test_set_the_weights_stay():
    readings, places, _ = rows()
    some = DataSet.parse(csv_text(joints_and_places(readings[:40], places[:40])), "few.csv")
    result = fit(measurements(ROBOT, some, model="geometry+kriging").task, Split.by_column(np.zeros(40, bool)))
    [term] = learnt_maps(result.identification.identified.state.model)
    assert_allclose(term.weights, 1.0)


def test_rows_that_are_too_few_make_no_map():
    readings, places, _ = rows()
    some = DataSet.parse(csv_text(joints_and_places(readings[:9], places[:9])), "few.csv")
    task = measurements(ROBOT, some, model="kriging").task
    with pytest.raises(ValueError, match="9 samples: an error map needs at least 10"):
        fit(task, Split.by_column(np.zeros(9, bool)))
