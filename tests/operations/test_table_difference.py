"""Difference of two tables of the elbow arm: which rows belong together, and their changes against its closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.devices import ControllerTable, TableRow
from cellctl.files import InputError, parse_yaml
from cellctl.formats import RobotFile, TableFile
from cellctl.formats.table import Row, TableRegion, TableRobot, TableSource
from cellctl.operations.results import as_json
from cellctl.operations.table_diff import ComparedTable, FactPair, RowChange, table_difference
from cellctl.robot_file import Tool
from tests.helpers.arms import ELBOW_ROBOT, ElbowArm

ROBOT = RobotFile.from_document(parse_yaml(ELBOW_ROBOT, "robot.yaml"))
TOOL = (120.0, 30.0, -15.0)
NOMINAL = [[0.0, -40.0, -60.0], [20.0, -30.0, -70.0], [-45.0, -55.0, -90.0]]


def row(number: int, change: tuple[float, float, float] = (0.0, 0.0, 0.0), **other: object) -> Row:
    """Target `number` (from 0) with its nominal joints, corrected by 0.1° each and by `change`."""
    values = {
        "target": [900.0 + number, 10.0, 300.0, 0.0, 90.0, 0.0],
        "nominal": NOMINAL[number],
        "compensated": [round(q + 0.1 + c, 6) for q, c in zip(NOMINAL[number], change, strict=True)],
        "predicted_before_mm": 1.0,
        "predicted_after_mm": 0.0,
        "sigma_mm": 0.1,
    }
    return Row.model_validate(values | other)


def table(
    *rows: Row, name: str = "one.json", tool: tuple[float, float, float] = TOOL, **other: object
) -> ComparedTable:
    parts: dict[str, object] = {
        "robot": TableRobot(serial="7", name="elbow arm"),
        "simulated": False,
        "tool": Tool(xyz=list(tool), mass=2.0),
        "source": TableSource(run=None, model_sha256="1" * 64, method="pseudo-target"),
        "joint_region": TableRegion(min=[-90.0] * 3, max=[90.0] * 3),
        "created": "2026-01-01",
    }
    return ComparedTable.of_file(name, TableFile.of(list(rows), **(parts | other)))  # type: ignore[arg-type]


def on_controller(*rows: Row, serial: str = "7") -> ComparedTable:
    held = tuple(TableRow(tuple(each.nominal), tuple(each.compensated)) for each in rows)
    return ComparedTable.of_controller("active", ControllerTable("c" * 64, serial, held))


def tcp(readings: list[float], tool: tuple[float, float, float]) -> np.ndarray:
    """In closed form, of the arm as its file says."""
    arm = ElbowArm(upper=500.0, fore=450.0, zero_deg=0.0, at=(0.0, 0.0, 0.0), tool=tool)
    return arm.tcp(np.array([readings]))[0]


def test_a_table_is_the_same_as_itself_in_another_order() -> None:
    found = table_difference(table(row(0), row(1), row(2)), table(row(2), row(0), row(1)), ROBOT)
    assert (found.matched, found.changed, found.only_a, found.only_b) == (3, [], [], [])
    assert (found.max_change_deg, found.max_tcp_mm) == (0.0, None)
    assert set(found.facts) == {"id"}, "nothing but the id, which depends on the order"
    assert table_difference(table(row(0)), table(row(0)), None).same


def test_a_changed_row_has_its_places_its_joint_and_the_distance_of_the_tcps() -> None:
    first, second = row(1), row(1, (0.02, -0.05, 0.01))
    found = table_difference(table(row(0), first), table(second, row(0)), ROBOT)
    [change] = found.changed
    far = float(np.linalg.norm(tcp(second.compensated, TOOL) - tcp(first.compensated, TOOL)))
    assert change.tcp_mm == pytest.approx(far, abs=1e-9)
    assert (change.row_a, change.row_b, change.joint, change.nominal_deg) == (2, 1, 2, 0.0)
    assert change.change_deg == pytest.approx(0.05, abs=1e-12)
    assert (found.max_change_deg, found.max_tcp_mm) == (change.change_deg, change.tcp_mm)


def test_the_tcp_of_each_table_is_that_of_its_own_tool() -> None:
    longer = (TOOL[0] + 10.0, *TOOL[1:])
    first, second = row(0), row(0, (0.0, 0.01, 0.0))
    found = table_difference(table(first), table(second, tool=longer), ROBOT)
    far = float(np.linalg.norm(tcp(second.compensated, longer) - tcp(first.compensated, TOOL)))
    assert found.max_tcp_mm == pytest.approx(far, abs=1e-9)
    assert found.facts["tool"].b["xyz"] == list(longer)


def test_rows_with_another_target_are_of_one_table_alone_and_with_another_posture_alone_changed() -> None:
    moved = row(2, target=[902.001, 10.0, 300.0, 0.0, 90.0, 0.0], nominal=[-45.001, -55.0, -90.0])
    found = table_difference(table(row(0), row(1), row(2)), table(moved, row(1)), None)
    assert (found.matched, found.only_a, found.only_b, found.changed) == (1, [1, 3], [1], [])
    assert not found.same
    found = table_difference(table(row(0)), table(row(0, nominal=[0.0, -40.0, -59.0])), None)
    assert [(each.nominal_deg, each.change_deg, each.tcp_mm) for each in found.changed] == [(1.0, 0.0, None)]


def test_of_rows_with_one_target_each_is_compared_with_the_one_of_its_own_posture() -> None:
    flipped = row(0, nominal=[30.0, -10.0, -30.0], compensated=[30.1, -9.9, -29.9])
    found = table_difference(table(row(0), flipped), table(flipped, row(0, (0.0, 0.0, 0.3))), None)
    [change] = found.changed
    assert (change.row_a, change.row_b, change.joint) == (1, 2, 3)
    assert (found.matched, found.only_a, found.only_b) == (2, [], [])


def test_rows_on_a_controller_are_found_by_their_nominal_joints() -> None:
    found = table_difference(table(row(0), row(1)), on_controller(row(2), row(1, (-0.2, 0.0, 0.0)), serial="8"), ROBOT)
    [change] = found.changed
    assert change == RowChange(2, 2, 1, pytest.approx(0.2), 0.0, pytest.approx(change.tcp_mm))
    assert (found.matched, found.only_a, found.only_b) == (1, [1], [1])
    assert found.facts == {"serial": FactPair("7", "8")}, "what only a file states is not compared"


def test_what_the_files_state_otherwise_is_named_with_both_values() -> None:
    source = TableSource(run="r", model_sha256="2" * 64, method="newton-raphson")
    found = table_difference(table(row(0)), table(row(0), source=source, simulated=True), None)
    method = ("pseudo-target", "newton-raphson")
    assert set(found.facts) == {"simulated", "run", "model_sha256", "method"}
    assert (found.facts["method"], found.facts["simulated"]) == (FactPair(*method), FactPair(False, True))
    assert as_json(found)["facts"]["run"] == {"a": None, "b": "r"}
    errors = table_difference(table(row(0)), table(row(0, sigma_mm=9.0)), None)
    assert (set(errors.facts), errors.changed) == ({"id"}, []), "predicted errors alone are a difference too"


def test_tables_of_robots_with_other_numbers_of_joints_share_no_row() -> None:
    four = {name: [0.0] * 4 for name in ("nominal", "compensated")}
    region = TableRegion(min=[-90.0] * 4, max=[90.0] * 4)
    found = table_difference(table(row(0), row(1)), table(row(0, **four), joint_region=region), None)
    assert found.facts["joints"] == FactPair(3, 4)
    assert (found.matched, found.only_a, found.only_b) == (0, [1, 2], [1])


def test_a_robot_file_of_another_robot_is_refused_for_each_table() -> None:
    wrong = table(row(0), name="two.json", robot=TableRobot(serial="7", name="a UR10"))
    with pytest.raises(InputError) as caught:
        table_difference(wrong, wrong, ROBOT)
    assert [problem.file for problem in caught.value.problems] == ["two.json"] * 2
    assert "is for a 'a UR10', the robot file is of a 'elbow arm'" in caught.value.problems[0].what
    four = on_controller(row(0, nominal=[0.0] * 4, compensated=[0.0] * 4))
    with pytest.raises(InputError, match="has 4 joints, the robot file has 3"):
        table_difference(four, four, ROBOT)
