"""Arrays, lists, DataFrames and mappings in and out; wrong ones are refused with place and cure."""

import sys

import numpy as np
import pytest

import cellctl
from tests.helpers.arms import ElbowArm


def test_a_robot_of_the_library_by_name_by_path_and_from_memory():
    ur10 = cellctl.robot("ur10")
    assert (ur10.name, ur10.n, ur10.limits.shape) == ("Universal Robots UR10", 6, (6, 2))
    again = cellctl.robot(ur10.file)
    np.testing.assert_array_equal(again.forward(np.zeros(6)), ur10.forward([0.0] * 6))
    assert cellctl.robot(ur10) is ur10


def test_forward_takes_degrees_and_gives_poses_in_mm(files):
    q = np.array([[20.0, -30.0, -60.0], [0.0, 0.0, -90.0]])
    nominal = ElbowArm(upper=500.0, fore=450.0, zero_deg=0.0, at=(0.0, 0.0, 0.0))
    robot = cellctl.robot("robot.yaml")
    poses = robot.forward(q)
    assert poses.shape == (2, 4, 4)
    np.testing.assert_allclose(poses[:, :3, 3], nominal.tcp(q), atol=1e-9)
    np.testing.assert_array_equal(robot.forward(q[1]), poses[1])
    q.setflags(write=False)
    np.testing.assert_array_equal(robot.forward(q), poses)


def test_a_frame_gives_the_model_of_its_arrays_and_results_become_frames(files, columns):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(columns)
    model = cellctl.fit("robot.yaml", frame, model="geometry")
    assert model.file == cellctl.fit("robot.yaml", columns, model="geometry").file
    found = model.predict(frame[["A1", "A2", "A3"]]).to_frame()
    assert list(found) == ["A1", "A2", "A3", "X", "Y", "Z", "A", "B", "C", "sigma", "sigma_among", "seen"]
    assert cellctl.read(frame).to_frame().equals(frame)


def test_missing_values_of_a_frame_are_empty_cells(columns):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"A1": [1.0, None], "n": pandas.array([1, None], dtype="Int64"), "set": ["fit", None]})
    assert cellctl.read(frame).rows.text() == "A1,n,set\n1.0,1,fit\n,,\n"


def test_without_pandas_arrays_and_mappings_do_all(files, columns, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    model = cellctl.fit("robot.yaml", columns, model="geometry")
    found = model.predict({name: columns[name] for name in ("A1", "A2", "A3")})
    assert found.to_dict()["X"].shape == (60,)
    assert model.compensate(found.poses[:3], postures=found.joints[:3]).to_dict()["A1"].shape == (3,)
    assert model._repr_html_()
    assert cellctl.read(columns)._repr_html_()
    with pytest.raises(ImportError, match=r"cellctl\[dataframes\]"):
        found.to_frame()


def test_predictions_are_near_the_true_robot(model, columns):
    q = np.column_stack([columns[name] for name in ("A1", "A2", "A3")])
    found = model.predict(q)
    assert np.linalg.norm(found.positions - ElbowArm().tcp(q), axis=1).max() < 0.05
    assert found.inside.all()
    assert (found.sigma_mm > 0.0).all()
    np.testing.assert_allclose(found.radius_95_mm, 1.614 * found.sigma_mm, rtol=1e-3)
    assert found.sigma_mm[0] < model.predict(np.array([170.0, 100.0, 100.0])).sigma_mm[0]


def test_radians_go_in_columns_named_for_them(model, columns):
    degrees = {name: np.array(columns[name]) for name in ("A1", "A2", "A3")}
    radians = {f"q{number}": np.deg2rad(degrees[f"A{number}"]) for number in (1, 2, 3)}
    np.testing.assert_allclose(model.predict(radians).positions, model.predict(degrees).positions, atol=1e-9)


INF = float("inf")
REFUSED = {
    "radians for degrees": (np.deg2rad([[20.0, -30.0, -60.0], [5.0, -20.0, -80.0]]), r"q: A1…A3 are radians.*q1…q3"),
    "NaN": ([[0.0, 0.0, 0.0], [0.0, float("nan"), 0.0]], r"q\[1\]: A2 is nan"),
    "infinite": ([[INF, 0.0, 0.0]], r"q\[0\]: A1 is inf"),
    "turned": (np.zeros((3, 5)), r"q: has the shape \(3, 5\), and the robot has 3 joints.*transpose"),
    "too few joints": ([0.0, 0.0], r"q: has the shape \(2,\)"),
    "none": (np.zeros((0, 3)), r"q: has the shape \(0, 3\)"),
    "text": ([["a", "b", "c"]], "q: is no array of numbers"),
    "complex": (np.array([[1j, 0, 0]]), "q: is no array of numbers"),
    "ragged": ([[1.0, 2.0], [1.0, 2.0, 3.0]], "q: is no array of numbers"),
    "beyond the limits": ([[0.0, -30.0, -60.0], [500.0, -30.0, -60.0]], r"q\[1\]: A1 is 500°, outside -180…180°"),
    "a column is missing": ({"A1": [0.0], "A2": [0.0]}, "q: has no complete set of joint readings.*missing: A3"),
    "a cell is missing": ({"A1": [0.0, np.nan], "A2": [0.0, 0.0], "A3": [-60.0, -60.0]}, r"q\[1\]: A1 is missing"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_joints_that_cannot_be_used_are_refused(model, case):
    given, words = REFUSED[case]
    with pytest.raises(cellctl.InputError, match=f"(?s){words}"):
        model.predict(given)


BAD_DATA = {
    "lengths": ({"A1": [1.0, 2.0], "X": [1.0]}, r"has columns of different length \(A1: 2, X: 1\)"),
    "two dimensions": ({"X": np.zeros((4, 3))}, r"column 'X' has the shape \(4, 3\)"),
    "one value": ({"X": 3.0}, r"column 'X' has the shape \(\)"),
    "no rows": ({"X": []}, "holds no rows"),
    "another type": (3, "is a int"),
    "an array": (np.zeros((4, 3)), "is a ndarray.*mapping from column to array"),
}


@pytest.mark.parametrize("case", BAD_DATA)
def test_data_that_cannot_be_used_is_refused(case):
    given, words = BAD_DATA[case]
    with pytest.raises(cellctl.InputError, match=f"(?s)data: {words}"):
        cellctl.read(given)


def test_a_column_of_the_same_name_twice_is_refused():
    pandas = pytest.importorskip("pandas")
    with pytest.raises(cellctl.InputError, match="column X more than once"):
        cellctl.read(pandas.DataFrame([[1.0, 2.0]], columns=["X", "X"]))


def test_rows_that_a_fit_cannot_use_are_listed_by_line(files, columns):
    places = np.array(columns["X"])
    places[4] = np.nan
    model = cellctl.fit("robot.yaml", {**columns, "X": places}, model="geometry")
    assert model.report["rejected"] == [{"line": 6, "reason": "X is missing"}]


def test_radians_in_columns_of_degrees_are_reported_before_the_fit(files, columns):
    turned = {name: np.deg2rad(columns[name]) for name in ("A1", "A2", "A3")}
    with pytest.raises(cellctl.InputError, match="radians"):
        cellctl.fit("robot.yaml", {**columns, **turned})


@pytest.mark.parametrize(("given", "words"), [("ur11", "did you mean ur10"), (7, "is a int"), ("no.yaml", "cannot be")])
def test_robots_that_do_not_exist_are_refused(given, words):
    with pytest.raises(cellctl.InputError, match=words):
        cellctl.robot(given)


def test_a_column_that_does_not_exist_is_named(columns):
    with pytest.raises(KeyError, match="the columns are A1, A2"):
        cellctl.read(columns)["Q"]
