"""`cellctl table diff`: which rows two tables share, how far their joints and the TCP differ, and what else."""

import json
from dataclasses import replace

import numpy as np
import pytest

from cellctl.devices import TableRow
from cellctl.formats import TableFile
from tests.helpers.arms import kr5_model

CHANGE_DEG = 0.05


@pytest.fixture
def cell(request):
    return request.config.rootpath / "procedures/cells/sphere_cell.yaml"


@pytest.fixture
def other(table, folder):
    """Writes `other.json`: the table with changes and an id that fits them."""

    def made(**changes):
        changed = TableFile.load(table).model_copy(update=changes)
        changed = changed.model_copy(update={"id": changed.content_id()})
        changed.save(folder / "other.json")
        return changed

    return made


@pytest.fixture
def difference(cellctl, folder):
    """The JSON of `table diff`, which is to end with `code`."""

    def found(*words, code=1):
        assert cellctl("table", "diff", *words, "--json", "diff.json") == code
        return json.loads((folder / "diff.json").read_text())

    return found


def turned(row, joint=2, by=CHANGE_DEG):
    """A row with another compensated reading of one joint (from 1)."""
    joints = list(row.compensated)
    joints[joint - 1] = round(joints[joint - 1] + by, 6)
    return row.model_copy(update={"compensated": joints})


def test_a_table_is_the_same_as_itself(cellctl, table, difference, capsys):
    found = difference(table, table, code=0)
    assert (found["same"], found["matched"], found["changed"], found["facts"]) == (True, 8, [], {})
    assert "are the same: 8 rows" in capsys.readouterr().out


def test_the_change_of_the_tcp_is_that_of_the_nominal_robot_with_the_tables_tool(table, other, difference):
    rows = TableFile.load(table).rows
    changed = other(rows=[turned(rows[0]), *rows[1:]])
    found = difference(table, "other.json", "--robot", "kr5_r1400")
    [row] = found["changed"]
    assert (found["max_change_deg"], found["max_tcp_mm"]) == (row["change_deg"], row["tcp_mm"])
    robot = kr5_model().robot
    a, b = (
        robot.chain().forward(robot.joint_map().model(np.array(joints)))[:3, 3]
        for joints in (rows[0].compensated, changed.rows[0].compensated)
    )
    assert row["tcp_mm"] == pytest.approx(float(np.linalg.norm(b - a)), abs=1e-9)
    assert 0.1 < row["tcp_mm"] < 2.0


def test_rows_of_one_table_alone_are_listed(table, other, difference, capsys):
    rows = TableFile.load(table).rows
    moved = rows[7].model_copy(
        update={
            "target": [rows[7].target[0] + 1e-3, *rows[7].target[1:]],
            "nominal": [rows[7].nominal[0] + 1e-3, *rows[7].nominal[1:]],
        }
    )
    other(rows=[*rows[2:7], moved])
    found = difference(table, "other.json")
    assert (found["matched"], found["only_a"], found["only_b"]) == (5, [1, 2, 8], [6])
    assert "only in other.json: row 6" in capsys.readouterr().out


def test_another_robots_file_is_refused(cellctl, table, capsys):
    assert cellctl("table", "diff", table, table, "--robot", "ur10") == 2
    assert "is for a 'KUKA KR5 R1400'" in capsys.readouterr().err


def test_tables_of_the_history_are_compared_by_their_ids(cellctl, controller, table, other, cell, difference):
    rows = TableFile.load(table).rows
    first, second = TableFile.load(table), other(rows=[turned(rows[0]), *rows[1:]])
    for file in (table, "other.json"):
        assert cellctl("table", "push", file, "--cell", cell) == 0
    found = difference(first.id[:10], second.id[:10])
    assert (found["a"]["id"], found["b"]["id"], len(found["changed"])) == (first.id, second.id, 1)


def test_the_active_table_is_compared_with_a_file(cellctl, controller, table, other, cell, difference, capsys):
    assert cellctl("table", "push", table, "--cell", cell) == 0
    assert difference("active", table, "--cell", cell, code=0)["matched"] == 8
    rows = TableFile.load(table).rows
    other(rows=[turned(rows[0]), *rows[1:]])
    [row] = difference("active", "other.json", "--cell", cell)["changed"]
    assert row["tcp_mm"] > 0.1  # by the cell's robot file


def test_rows_that_were_changed_on_the_controller_are_found_by_their_nominal_joints(
    cellctl, controller, table, cell, difference
):
    assert cellctl("table", "push", table, "--cell", cell) == 0
    row = controller.active.rows[3]
    changed = TableRow(row.nominal, (row.compensated[0] + CHANGE_DEG, *row.compensated[1:]))
    rows = (*controller.active.rows[4:], changed, *controller.active.rows[:3])
    controller.active = replace(controller.active, rows=rows)
    [found] = difference(table, "active", "--cell", cell)["changed"]
    assert (found["row_a"], found["row_b"], found["joint"]) == (4, 5, 1)


def test_active_needs_a_cell_and_a_table_in_force(cellctl, controller, table, cell, capsys):
    assert cellctl("table", "diff", "active", table) == 2
    assert "give --cell CELL" in capsys.readouterr().err
    assert cellctl("table", "diff", "active", table, "--cell", cell) == 2
    assert "no table is in force on controller 'SIM-4711'" in capsys.readouterr().err
