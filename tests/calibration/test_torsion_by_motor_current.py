"""Fits with motor currents on simulated robots: drives that turn by the weight alone, and by friction too."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from cellctl.calibration import Split, fit
from cellctl.files import InputError
from cellctl.formats import DataSet, RobotFile
from cellctl.formats.measurements import measurements
from tests.helpers.simulated_data import KR5_FILE, motor_rows, motor_world

KR5 = RobotFile.load(KR5_FILE)
FLOOR_MM = 0.02 * np.sqrt(3.0)
"""RMS of the noise of the held-out positions."""


@cache
def rows(seed, friction, count):
    return motor_rows(motor_world(seed, friction), count, 5 + seed)


@pytest.fixture
def fitted(tmp_path):
    def found(seed, friction, model, count=240, held_out=80):
        path = rows(seed, friction, count).write(tmp_path / "rows.csv", held_out)
        measured = measurements(KR5, DataSet.load(path), measure="position", model=model)
        return fit(measured.task, Split.by_column(np.array(measured.sets) == "test"))

    return found


def amounts(result):
    """Flexibility (6,) and its 1 σ, rad/A."""
    found = result.identification.identified
    places = [found.unknowns.names.index(f"flexibility{joint}") for joint in range(1, 7)]
    return found.deviations[places], np.sqrt(np.diag(found.covariance))[places]


def true_flexibility(seed):
    one = motor_world(seed, 1.0)
    return np.multiply(one._compliance.rates, one.motors.nm_per_a) * 1e3


def test_where_friction_winds_up_the_drives_flexibility_is_found_and_the_rest_is_noise(fitted):
    result = fitted(1, 1.0, "geometry+motor", count=140, held_out=60)
    found, sigma = amounts(result)
    assert np.abs((found - true_flexibility(1)) / sigma).max() < 4.0
    assert sigma[:3].max() < 0.05 * true_flexibility(1)[:3].min()
    assert result.test.rms < 1.3 * FLOOR_MM


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_where_friction_winds_up_the_drives_currents_predict_better_than_weight(fitted, seed):
    """Compliance knows the weight alone; with the side of approach, backlash takes the friction."""
    motor, weight, sides = (
        fitted(seed, 1.0, f"geometry+{model}").test.rms for model in ("motor", "compliance", "compliance+backlash")
    )
    assert motor < 1.2 * FLOOR_MM
    assert weight > 5.0 * motor
    assert sides < 1.2 * FLOOR_MM


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_where_the_drives_turn_by_the_weight_alone_weight_predicts_better_than_currents(fitted, seed):
    motor, weight = (fitted(seed, 0.0, f"geometry+{model}").test.rms for model in ("motor", "compliance"))
    assert weight < 1.2 * FLOOR_MM
    assert motor > 1.8 * weight


def test_rows_that_lack_a_current_are_named_and_a_model_without_currents_uses_them(tmp_path):
    some = rows(1, 1.0, 140)
    currents = some.currents.copy()
    path = some.write(tmp_path / "rows.csv", 40)
    lines = path.read_text().splitlines()
    first = f"{currents[7, 2]}"
    lines[8] = lines[8].replace(first, "")
    path.write_text("\n".join(lines))
    with pytest.raises(InputError) as refused:
        measurements(KR5, DataSet.load(path), measure="position", model="geometry+motor")
    assert "1 of 140 rows lack a motor current, and --model names motor: lines 9" in str(refused.value)
    assert "leave motor out of --model" in str(refused.value)
    assert len(measurements(KR5, DataSet.load(path), measure="position", model="geometry").lines) == 140


@pytest.mark.parametrize("how", ["absent", "constant"])
def test_a_model_with_currents_is_refused_where_no_current_changes(tmp_path, how):
    some = rows(1, 1.0, 140)
    if how == "constant":
        some = replace(some, currents=np.ones((140, 6)))
    path = some.write(tmp_path / "rows.csv", 40, currents=how == "constant")
    with pytest.raises(InputError, match="motor cannot be seen in this data set") as refused:
        measurements(KR5, DataSet.load(path), measure="position", model="geometry+motor")
    assert "columns I1…In with a number in every row" in str(refused.value)


def test_auto_does_not_try_currents_because_a_table_has_none(tmp_path):
    path = rows(1, 1.0, 140).write(tmp_path / "rows.csv", 40)
    task = measurements(KR5, DataSet.load(path), measure="position", model="auto").task
    assert task.candidates
    assert "motor" not in {effect.group for effect in task.candidates}
