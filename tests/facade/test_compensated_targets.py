"""`Model.compensate`: joints for each target or the reason why not; the table is that of the command line."""

import io
import json

import numpy as np
import pytest

import cellctl
from cellctl.files import InputError
from cellctl.formats import TableFile
from cellctl.operations.compensating import controller_of_model
from cellctl.operations.fit_options import Judging
from tests.helpers.arms import cellctl as command
from tests.helpers.arms import kr5_model, printed_errors, readings_near_the_middle, targets_csv


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """`model.json` and `targets.csv`: eight targets with postures nearby."""
    kr5_model().save(tmp_path / "model.json")
    (tmp_path / "targets.csv").write_text(targets_csv(readings_near_the_middle(8)))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def model(folder):
    return cellctl.load("model.json")


def test_the_table_is_that_of_the_command(model, folder):
    assert command("compensate", "model.json", "targets.csv", "--serial", "SIM-1", "-o", "table.json") == 0
    made = TableFile.load(folder / "table.json")
    found = model.compensate("targets.csv")
    assert found.table(serial="SIM-1").id == made.id
    np.testing.assert_array_equal(found.joints.round(6), [row.compensated for row in made.rows])
    assert found.reached.all()
    assert found.reasons == ("",) * 8


def test_arrays_columns_and_files_give_the_same_joints(model):
    by_file = model.compensate("targets.csv", method="newton-raphson")
    columns = {name: values for name, values in cellctl.read("targets.csv").to_dict().items() if name != "nominal"}
    near = readings_near_the_middle(8)
    for found in (
        model.compensate(by_file.targets, postures=near, method="newton-raphson"),
        model.compensate(by_file.targets.tolist(), postures=near.tolist(), method="newton-raphson"),
        model.compensate(columns, method="newton-raphson"),
    ):
        np.testing.assert_allclose(found.joints, by_file.joints, atol=2e-6)
    assert by_file.predicted_after_mm.max() < 1e-3 < by_file.predicted_before_mm.min()


def test_one_bad_target_has_its_reason_and_the_others_their_joints(model):
    good = model.compensate("targets.csv")
    targets = good.targets.copy()
    targets[2, :3, 3] += 9000.0
    found = model.compensate(targets, postures=readings_near_the_middle(8))
    assert "reach" in found.reasons[2]
    assert found.reached.tolist() == [True, True, False, *[True] * 5]
    np.testing.assert_allclose(np.delete(found.joints, 2, axis=0), np.delete(good.joints, 2, axis=0), atol=2e-6)
    assert np.isnan(found.joints[2]).all()
    with pytest.raises(cellctl.InputError, match=r"targets\[2\]: .*reach"):
        found.table(serial="SIM-1")


def test_no_target_with_joints_is_a_result_and_not_an_error(model):
    found = model.compensate(model.compensate("targets.csv").targets + np.diag([0.0] * 4) + far(9000.0))
    assert not found.reached.any()
    assert np.isnan(found.predicted_after_mm).all()
    assert "0 of 8 targets" in found._repr_html_()


def far(mm):
    shift = np.zeros((4, 4))
    shift[:3, 3] = mm
    return shift


def test_csv_is_that_of_the_command_and_refuses_as_the_table_does(model, folder):
    assert command("compensate", "model.json", "targets.csv", "-o", "command.csv") == 0
    found = model.compensate("targets.csv")
    found.to_csv("python.csv")
    assert (folder / "python.csv").read_text() == (folder / "command.csv").read_text()
    assert [*found.to_dict()] == [*cellctl.read("command.csv").columns, "reason"]
    np.testing.assert_array_equal(found.to_dict()["A1"], found.joints[:, 0])
    targets = found.targets.copy()
    targets[0, :3, 3] += 9000.0
    partly = model.compensate(targets, postures=readings_near_the_middle(8))
    assert np.isnan(partly.to_dict()["pseudo_X"]).tolist() == [True] + [False] * 7
    assert partly.to_dict()["reason"].tolist() == list(partly.reasons)
    with pytest.raises(cellctl.InputError, match=r"targets\[0\]"):
        partly.to_csv("python.csv")


def test_all_methods_are_compared_as_by_the_command(model, folder):
    assert command("compensate", "model.json", "targets.csv", "--method", "all", "--json", "all.json") == 0
    told = json.loads((folder / "all.json").read_text())["methods"]
    found = json.loads(json.dumps(model.compare_methods("targets.csv")))
    for each in (*told, *found):
        each.pop("seconds_per_target")
    assert found == told


def test_one_pass_leaves_more_than_all(model):
    once, all_of_them = model.compensate("targets.csv", passes=1), model.compensate("targets.csv")
    assert once.predicted_after_mm.max() > 10.0 * all_of_them.predicted_after_mm.max()


def test_another_robot_than_the_cells_is_refused_as_by_the_command(model, capsys):
    options = ("--cell", "heavy_robot_cell", "--serial", "1")
    assert command("compensate", "model.json", "targets.csv", *options) == 2
    printed = printed_errors(capsys)
    with pytest.raises(cellctl.InputError) as refused:
        model.compensate("targets.csv", cell="heavy_robot_cell")
    assert str(refused.value) == printed


def test_another_predictor_of_errors_takes_readings_in_degrees(model):
    def errors(q):
        return model.predict(q).positions - model.nominal_poses(q)[:, :3, 3]

    own = model.compensate("targets.csv", method="cyclic-search", errors=errors)
    np.testing.assert_allclose(own.joints, model.compensate("targets.csv", method="cyclic-search").joints, atol=1e-4)


class Map:
    """An error map over model angles, rad."""

    def errors(self, q):
        return np.full((len(q), 3), 0.2)


class SureMap(Map):
    def sigma(self, q):
        return np.full((len(q), 3), 0.01)


def test_errors_of_another_predictor_have_its_own_sigma_or_none(model, folder):
    def made(errors):
        return model.compensate("targets.csv", method="cyclic-search", errors=errors)

    np.testing.assert_allclose(made(SureMap()).sigma_mm, 0.01 * np.sqrt(3.0), rtol=1e-6)
    for errors in (Map(), lambda q: np.full((len(q), 3), 0.2)):
        found = made(errors)
        assert np.isnan(found.sigma_mm).all()
        table = found.table(serial="SIM-1")
        assert {row.sigma_mm for row in table.rows} == {None}
        assert max(row.predicted_after_mm for row in table.rows) < 1e-3  # by the same predictor
        assert "1 σ" not in found._repr_html_()
        found.to_csv("none.csv")
        assert all(line.endswith(",") for line in (folder / "none.csv").read_text().splitlines()[1:])


def test_sigma_beside_what_was_touched_is_that_of_a_prediction_in_the_frame_of_the_points(folder):
    wide = kr5_model().model_copy(update={"outside_mm": 0.3, "scatter_mm": 0.08})
    wide.save(folder / "wide.json")
    model = cellctl.load("wide.json")
    found = model.compensate("targets.csv")
    np.testing.assert_allclose(found.sigma_mm, model.predict(found.joints, frame="points").sigma_mm, atol=1e-9)
    assert found.sigma_mm.min() > 0.08
    assert (model.predict(found.joints).sigma_mm > found.sigma_mm).all()
    with pytest.raises(cellctl.InputError, match="--frame: 'robot' is not known"):
        model.predict(found.joints, frame="robot")


@pytest.mark.parametrize("method", ["pseudo-target", "newton-raphson", "cyclic-search"])
def test_full_precision_closes_to_a_nanometre_and_rounding_is_stated(model, folder, method):
    found = model.compensate("targets.csv", method=method)
    assert found.predicted_after_mm.max() <= 1e-6
    tip = model.predict(found.joints).positions
    assert np.linalg.norm(tip - found.targets[:, :3, 3], axis=1).max() <= 2e-6
    options = ("--method", method, "-o", "out.csv", "--json", "out.json")
    assert command("compensate", "model.json", "targets.csv", *options) == 0
    told = json.loads((folder / "out.json").read_text())
    assert told["predicted_after_mm"]["max"] <= 1e-6 < told["written"]["predicted_after_mm"]["max"] < 1e-3
    assert told["written"]["joint_decimals"] == 6
    np.testing.assert_allclose([row["compensated"] for row in told["targets"]], found.joints, rtol=0, atol=1e-12)


def test_one_pose_is_one_target(model):
    pose = model.compensate("targets.csv").targets[3]
    assert len(model.compensate(pose, postures=readings_near_the_middle(8)[3])) == 1


def skewed():
    pose = np.eye(4)
    pose[0, 0] = 1.1
    return [np.eye(4), pose]


REFUSED = {
    "no rotation": ({"targets": skewed()}, r"targets\[1\]: is no rigid motion"),
    "NaN": ({"targets": np.full((1, 4, 4), np.nan)}, r"targets\[0\]: is no rigid motion"),
    "positions alone": ({"targets": np.zeros((5, 3))}, r"targets: has the shape \(5, 3\).*X, Y, Z and A, B, C"),
    "no orientation": ({"targets": {"X": [1], "Y": [1], "Z": [1]}}, "targets: has no orientation"),
    "fewer postures": (
        {"targets": np.tile(np.eye(4), (3, 1, 1)), "postures": np.zeros((2, 6))},
        "postures: has 2 rows for 3 targets",
    ),
    "postures twice": ({"targets": "targets.csv", "postures": np.zeros((8, 6))}, "postures: go with an array"),
    "passes": ({"targets": np.eye(4), "passes": 0}, "--passes: 0 is out of range"),
    "predictor": ({"targets": np.eye(4), "errors": np.negative}, "errors: are not for the method 'pseudo-target'"),
    "predictor of joints": (
        {"targets": np.eye(4), "postures": np.zeros(6), "errors": np.negative, "method": "cyclic-search"},
        r"errors: gave the shape \(1, 6\)",
    ),
    "method": ({"targets": np.eye(4), "method": "guess"}, "--method: 'guess' is not known"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_targets_that_cannot_be_read_are_refused(model, case):
    given, words = REFUSED[case]
    with pytest.raises(cellctl.InputError, match=f"(?s){words}"):
        model.compensate(**given)


def test_a_table_needs_the_controllers_serial(model):
    with pytest.raises(cellctl.InputError, match="does not say on whose controller it was learnt"):
        model.compensate("targets.csv").table()


def test_a_frame_of_the_result_is_a_file_for_pandas(model):
    pandas = pytest.importorskip("pandas")
    frame = model.compensate("targets.csv").to_frame()
    text = frame.to_csv(index=False)
    assert pandas.read_csv(io.StringIO(text)).shape == frame.shape == (8, 6 + 12 + 6 + 4)


def test_an_empty_serial_is_refused_by_cellctls_own_error():
    with pytest.raises(InputError, match="--serial: is empty"):
        controller_of_model(None, kr5_model(), "")


@pytest.mark.parametrize("wrong", [{"holdout": "0.3"}, {"folds": "5"}, {"seed": "x"}, {"folds": 2.5}, {"folds": True}])
def test_options_of_another_type_are_refused_by_cellctls_own_error(wrong):
    (name, value), *_ = wrong.items()
    found = Judging(**{**dict.fromkeys(("holdout", "folds", "column", "by")), "seed": 0, **wrong}).problems()
    assert [problem.file for problem in found] == [f"--{name}"]
    assert repr(value) in found[0].what
