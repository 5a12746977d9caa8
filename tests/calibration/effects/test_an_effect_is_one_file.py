"""A new effect is a class and a line of the tuple: fit, model file, prediction and report know it without an edit."""

import numpy as np
import pytest
import yaml

from cellctl.calibration import Split, effects, fit
from cellctl.calibration.effects import EFFECTS
from cellctl.cli.fit import predict
from cellctl.files import InputError
from cellctl.formats import DataSet, ModelFile, RobotFile, fit_report, measurements
from cellctl.report.fit import FitStory
from cellctl.report.fit.page import write_fit_page
from docs.examples.calibration_kit.calibration_kit.effect import ToolHeat
from tests.helpers import arms
from tests.helpers.simulated_data import positions_in_the_heat

ROBOT = RobotFile.model_validate(yaml.safe_load(arms.ELBOW_ROBOT))
PER_K = np.array([0.004, -0.002, 0.012])
"""By which the tool of these tests moves in the flange's frame, mm/K."""


@pytest.fixture(autouse=True)
def with_one_effect_more(monkeypatch):
    monkeypatch.setattr(effects, "EFFECTS", (*EFFECTS, ToolHeat))


def data(warm: bool = True) -> DataSet:
    return DataSet.parse(positions_in_the_heat(PER_K, warm=warm), "data.csv")


def fitted(model: str):
    measured = measurements(ROBOT, data(), model=model)
    split = Split.by_column(np.arange(120) >= 90)
    return measured, split, fit(measured.task, split)


@pytest.fixture
def found():
    return fitted("geometry+tool_heat")


def test_it_is_found_by_name_with_the_amounts_that_are_there(found):
    _, _, result = found
    model = result.identification.identified.state.model
    assert result.model == "geometry+tool_heat"
    assert [model.amount(f"tool_heat_{axis}") for axis in "xyz"] == pytest.approx(PER_K, abs=0.001)
    assert result.test.rms < 0.1 * result.nominal.rms


def test_auto_tries_it_and_keeps_it():
    assert "tool_heat" in fitted("auto")[2].model.split("+")


def test_rows_that_cannot_show_it_are_refused_with_what_it_needs():
    with pytest.raises(InputError, match="a column temperature with different values"):
        measurements(ROBOT, data(warm=False), model="geometry+tool_heat")


def test_a_model_file_holds_it_and_predicts_with_it(found, tmp_path, capsys):
    measured, _, result = found
    file, joints = tmp_path / "model.json", tmp_path / "joints.csv"
    ModelFile.of(ROBOT, measured, result).save(file)
    again = ModelFile.load(file)
    assert again.text() == file.read_text()
    at = measured.task.rows.only.postures
    identified = result.identification.identified.state.model
    np.testing.assert_allclose(again.predict(measured.readings, at).poses, identified.pose(at), atol=1e-9)
    joints.write_text("A1,A2,A3\n10,20,30\n")
    predict(file, joints)
    assert "the tool is taken to be at 20 °C" in capsys.readouterr().err


@pytest.mark.long
def test_a_report_has_its_title_its_labels_and_its_unit(found, tmp_path):
    measured, split, result = found
    page = tmp_path / "page.html"
    write_fit_page(page, FitStory.of(measured, result, split, fit_report(measured, result), {}))
    for words in ("Tool heat", "tool heat Z", "µm/K"):
        assert words in page.read_text()


def test_what_rows_do_not_show_of_it_is_named_in_its_own_words():
    from cellctl.calibration import PositionRows, RobotModel, Task

    rows = measurements(ROBOT, data(), model="geometry").task.rows.only
    bare = PositionRows(rows.q, rows.xyz, rows.sigma)
    seen = fit(Task(RobotModel(ROBOT.chain(), (ToolHeat(),)), bare), Split(np.arange(120), ())).observability
    assert any("tool heat along X, Y, Z" in phrase for phrase in seen.unseen)
