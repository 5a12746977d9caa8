"""Table files: their id is their content, and what is not for a controller is refused, row by row."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import cellctl.formats.table
from cellctl.files import InputError
from cellctl.formats import RobotFile, TableFile, compensated_targets, table_of, table_problems
from cellctl.formats.table_making import nominal_chain
from tests.helpers.arms import kr5_model, readings_near_the_middle

CREATED = "2026-11-21T20:00:00Z"


@pytest.fixture(scope="module")
def model():
    return kr5_model()


@pytest.fixture(scope="module")
def table(model):
    return made(model, readings_near_the_middle(6))


def made(model, readings, *, serial="SIM-1", simulated=True, created=CREATED):
    targets = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    found = compensated_targets(model, targets, readings)
    return table_of(model, targets, found, serial=serial, simulated=simulated, run="run-1", created=created)


def problems(table, *, serial="SIM-1", simulated=True, robot=None, correction_deg=2.0):
    robot = robot or kr5_model().robot
    return table_problems(table, serial=serial, simulated=simulated, robot=robot, correction_deg=correction_deg)


def test_a_file_comes_back_as_it_was_written(table, tmp_path):
    table.save(tmp_path / "table.json")
    again = TableFile.load(tmp_path / "table.json")
    assert again == table
    assert again.text() == (tmp_path / "table.json").read_text()


def test_the_id_is_the_sha256_of_the_content_without_id_and_created(table, tmp_path):
    table.save(tmp_path / "table.json")
    content = json.loads((tmp_path / "table.json").read_text())
    said = content.pop("id")
    content.pop("created")
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    assert hashlib.sha256(canonical.encode()).hexdigest() == said


def test_the_same_model_and_targets_give_the_same_id_whenever_it_is_made(model, table):
    later = made(model, readings_near_the_middle(6), created="2027-01-01T00:00:00Z")
    assert later.id == table.id
    assert made(model, readings_near_the_middle(6, seed=2)).id != table.id


@pytest.mark.parametrize(
    ("where", "value"),
    [
        (("rows", 2, "compensated", 3), 11.0),
        (("rows", 0, "sigma_mm"), 0.0),
        (("robot", "serial"), "925185"),
        (("simulated",), False),
        (("joint_region", "max", 0), 180.0),
        (("payload",), 3.0),
    ],
)
def test_a_tampered_table_is_refused_and_named(table, tmp_path, where, value):
    content = json.loads(table.text())
    part = content
    for key in where[:-1]:
        part = part[key]
    part[where[-1]] = value
    (tmp_path / "table.json").write_text(json.dumps(content))
    with pytest.raises(InputError) as refused:
        TableFile.load(tmp_path / "table.json")
    assert f"content is not that of table {table.id[:12]}" in str(refused.value)


def test_another_label_of_the_time_is_no_tampering(table, tmp_path):
    content = json.loads(table.text()) | {"created": "yesterday"}
    (tmp_path / "table.json").write_text(json.dumps(content, indent=3))
    assert TableFile.load(tmp_path / "table.json").id == table.id


@pytest.mark.parametrize("content", ["", "{}", "[1]", '{"format": "cellctl table 2"}', "\xff", '{"rows": [NaN]}'])
def test_a_file_that_is_no_table_is_refused(tmp_path, content):
    (tmp_path / "table.json").write_text(content, encoding="latin-1")
    with pytest.raises(InputError, match="no table file"):
        TableFile.load(tmp_path / "table.json")


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(st.characters()),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@given(st.sampled_from(["rows", "robot", "tool", "id", "joint_region", "payload", "source"]), _JSON)
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_stands_in_a_field_is_refused_in_words(table, tmp_path, name, value):
    content = json.loads(table.text())
    if content[name] == value:
        return
    content[name] = value
    (tmp_path / "table.json").write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(InputError, match=r"table\.json"):
        TableFile.load(tmp_path / "table.json")


@pytest.mark.parametrize("text", ["[" * 100_000, '{"payload": 1e999}', '{"id": "\\ud800"}'])
def test_json_that_python_chokes_on_is_refused_too(tmp_path, text):
    (tmp_path / "table.json").write_text(text)
    with pytest.raises(InputError, match="no table file"):
        TableFile.load(tmp_path / "table.json")


def test_a_row_with_a_joint_too_few_is_named(table, tmp_path):
    row = table.rows[1].model_copy(update={"compensated": table.rows[1].compensated[:5]})
    short = table.model_copy(update={"rows": [table.rows[0], row]})
    short.model_copy(update={"id": short.content_id()}).save(tmp_path / "table.json")
    with pytest.raises(InputError, match="row 2: not 6 joints"):
        TableFile.load(tmp_path / "table.json")


def test_the_published_schema_is_that_of_the_files(table):
    schema = json.loads((Path(cellctl.formats.table.__file__).parent / "table.schema.json").read_text())
    schema.pop("$schema")
    assert schema == TableFile.model_json_schema()
    assert set(schema["required"]) == set(json.loads(table.text()))


def test_joints_are_written_as_the_controller_takes_them(table):
    for nominal, compensated in table.pairs():
        for value in (*nominal, *compensated):
            assert float(f"{value:.6f}") == value
            assert f"{value:.6f}" != "-0.000000"


def test_the_predicted_distances_are_those_of_the_written_joints(model, table):
    tip = model.predict(np.array([row.compensated for row in table.rows])).poses[:, :3, 3]
    off = np.linalg.norm(tip - np.array([row.target[:3] for row in table.rows]), axis=1)
    np.testing.assert_allclose([row.predicted_after_mm for row in table.rows], off, atol=1e-8)
    assert max(row.predicted_after_mm for row in table.rows) < 1e-3 < 0.5 < table.rows[0].predicted_before_mm


def test_heading_and_height_that_no_touch_sees_do_not_count_beside_the_spheres():
    readings = readings_near_the_middle(5)
    touched, measured = (kr5_model(touches=of).sigma(readings, frame="points") for of in (True, False))
    assert touched.max() < 0.3
    assert measured.min() > 0.8


def test_what_is_for_this_controller_has_no_problems(table):
    assert problems(table) == []


def test_a_table_for_another_controller_robot_tool_or_payload_is_refused_all_at_once(table):
    robot = kr5_model().robot
    other = robot.model_copy(
        update={
            "name": "KUKA KR6",
            "tool": robot.tool.model_copy(update={"xyz": [59.9, 50.5, 411.0], "mass": 2.0}),
        }
    )
    said = problems(table, serial="SIM-2", robot=other)
    assert len(said) == 4
    assert "'SIM-1', this one is 'SIM-2'" in said[0]
    assert "KR6" in said[1]
    assert "411" in said[2]
    assert "payload" in said[3]


@pytest.mark.parametrize(("learnt", "runs_on"), [(True, False), (False, True)])
def test_simulator_data_stays_on_simulators_and_real_data_on_real_robots(model, learnt, runs_on):
    table = made(model, readings_near_the_middle(2), serial="77", simulated=learnt)
    (said,) = problems(table, serial="77", simulated=runs_on)
    assert "simulator" in said


def test_a_row_outside_limits_or_where_the_model_never_saw_the_robot_is_named(table):
    beyond = table.rows[1].model_copy(update={"compensated": [0.0, 66.0, 80.0, 10.0, 60.0, 20.0]})
    unseen = table.rows[3].model_copy(update={"nominal": [60.0, -60.0, 80.0, 10.0, 60.0, 20.0]})
    rows = [table.rows[0], beyond, table.rows[2], unseen]
    said = problems(table.model_copy(update={"rows": rows}), correction_deg=360.0)
    assert any(line.startswith("row 2: compensated A2 66.000°") and "limits" in line for line in said)
    assert any(line.startswith("row 4: nominal A1 60.000°") and "outside the measured region" in line for line in said)
    assert not any(line.startswith(("row 1", "row 3")) for line in said)


def test_a_correction_over_the_cells_limit_is_named_with_its_axis(table):
    far = [table.rows[0].nominal[0] + 1.25, *table.rows[0].compensated[1:]]
    changed = table.model_copy(update={"rows": [table.rows[0].model_copy(update={"compensated": far})]})
    assert problems(changed, correction_deg=2.0) == []
    (said,) = problems(changed, correction_deg=1.0)
    assert said == "row 1: A1 is corrected by +1.250°, the cell allows 1°"


def test_a_target_out_of_reach_makes_no_table(model):
    readings = readings_near_the_middle(3)
    targets = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    targets[1, :3, 3] = [4000.0, 0.0, 0.0]
    found = compensated_targets(model, targets, readings)
    with pytest.raises(ValueError, match="row 2: the target is out of the robot"):
        table_of(model, targets, found, serial="SIM-1", simulated=True, run=None, created=CREATED)


def test_another_robot_file_with_fewer_joints_is_refused_before_rows_are_looked_at(table):
    small = RobotFile.model_construct(**{**kr5_model().robot.__dict__, "links": [], "joints": []})
    assert any("joints, the cell's robot has 0" in line for line in problems(table, robot=small))
