"""`cellctl table`: what comes into a controller's force, what is refused, and how each end is told."""

import json
from dataclasses import replace

import pytest

from cellctl.devices import DeviceFault, DeviceLost, DeviceUncertain, TableRow
from cellctl.formats import TableFile
from tests.helpers.arms import kr5_model

SHIPPED = "procedures/cells/sphere_cell.yaml"


@pytest.fixture
def cell(request):
    return request.config.rootpath / SHIPPED


def remade(table, **changes):
    """The table with `changes` and an id that fits them, as somebody else's would have."""
    changed = TableFile.load(table).model_copy(update=changes)
    changed.model_copy(update={"id": changed.content_id()}).save(table)


def test_a_pushed_table_is_in_force_read_back_and_verified(cellctl, controller, table, cell, folder, capsys):
    assert cellctl("table", "push", table, "--cell", cell, "--json", "pushed.json") == 0
    file = TableFile.load(table)
    done = json.loads((folder / "pushed.json").read_text())
    yes = dict.fromkeys(("pushed", "verified", "active", "recorded"), True)
    assert done == {"id": file.id, "serial": "SIM-4711", "rows": 8, **yes}
    assert [(row.nominal, row.compensated) for row in controller.active.rows] == list(file.pairs())
    assert cellctl("table", "verify", table, "--cell", cell) == 0
    assert "all 8 rows" in capsys.readouterr().out


def test_another_controllers_table_is_refused_and_nothing_is_written(cellctl, controller, table, cell, capsys):
    controller.identity = replace(controller.identity, serial="SIM-1")
    assert cellctl("table", "push", table, "--cell", cell) == 2
    assert "for controller 'SIM-4711', this one is 'SIM-1'" in capsys.readouterr().err
    assert controller.active is None


def test_a_simulators_table_is_refused_by_a_real_controller(cellctl, controller, table, cell, capsys):
    controller.identity = replace(controller.identity, simulated=False)
    assert cellctl("table", "push", table, "--cell", cell) == 2
    assert "learnt on a simulator" in capsys.readouterr().err
    assert controller.active is None


def test_a_tampered_table_is_refused_before_anything_is_connected(cellctl, controller, table, cell, capsys):
    content = json.loads(table.read_text())
    content["rows"][4]["compensated"][1] += 0.5
    table.write_text(json.dumps(content))
    assert cellctl("table", "push", table, "--cell", cell) == 2
    assert "was changed after it was made" in capsys.readouterr().err
    assert controller.connections == 0


def test_a_correction_over_the_cells_limit_is_refused_by_row(cellctl, controller, table, cell, capsys):
    rows = TableFile.load(table).rows
    rows[4] = rows[4].model_copy(update={"compensated": [rows[4].nominal[0] - 2.5, *rows[4].compensated[1:]]})
    remade(table, rows=rows)
    assert cellctl("table", "push", table, "--cell", cell) == 2
    said = capsys.readouterr().err
    assert "row 5: A1 is corrected by -2.500°, the cell allows 2°" in said
    assert controller.active is None


def test_another_tools_table_is_refused(cellctl, controller, table, cell, capsys):
    tool = kr5_model().robot.tool
    remade(table, tool=tool.model_copy(update={"xyz": [0.0, 0.0, 300.0]}))
    assert cellctl("table", "push", table, "--cell", cell) == 2
    assert "it is for the tool (0, 0, 300) mm" in capsys.readouterr().err


def test_every_reason_is_reported_at_once(cellctl, controller, table, cell, capsys):
    controller.identity = replace(controller.identity, serial="925185", simulated=False)
    remade(table, payload=9.0)
    assert cellctl("table", "push", table, "--cell", cell) == 2
    assert "3 errors, nothing was written" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (DeviceFault("robot", "row 3 came back otherwise"), 3),
        (DeviceLost("robot", "the connection was lost; the old table is in force"), 3),
        (DeviceUncertain("robot", "the connection was lost at the activation"), 4),
    ],
)
def test_how_a_push_failed_is_reported_by_the_exit_code(cellctl, controller, table, cell, capsys, error, code):
    controller.failing = error
    assert cellctl("table", "push", table, "--cell", cell) == code
    assert error.what in capsys.readouterr().err


def test_a_controller_that_holds_other_rows_than_were_pushed_is_a_fault(cellctl, controller, table, cell, capsys):
    controller.tamper = shifted
    assert cellctl("table", "push", table, "--cell", cell) == 3
    said = capsys.readouterr().err
    assert "other joints in row 2" in said
    assert "rollback" in said


def test_a_connection_that_ends_after_the_push_is_reported_as_such(cellctl, controller, table, cell, capsys):
    async def gone():
        raise DeviceLost("robot", "the controller closed the channel")

    controller.read_table = gone
    assert cellctl("table", "push", table, "--cell", cell) == 3
    assert f"table {TableFile.load(table).id[:12]} is in force, but" in capsys.readouterr().err
    assert controller.active.id == TableFile.load(table).id


def test_verify_tells_a_table_that_differs_in_the_sixth_decimal(cellctl, controller, table, cell, capsys, folder):
    controller.tamper = shifted
    cellctl("table", "push", table, "--cell", cell)
    assert cellctl("table", "verify", table, "--cell", cell, "--json", "verified.json") == 1
    done = json.loads((folder / "verified.json").read_text())
    assert done["same"] is False
    assert done["differences"] == ["other joints in row 2"]


def test_verify_tells_that_none_or_another_is_in_force(cellctl, controller, table, cell, capsys):
    assert cellctl("table", "verify", table, "--cell", cell) == 1
    assert "no table is in force" in capsys.readouterr().out
    assert cellctl("table", "push", table, "--cell", cell) == 0
    controller.active = replace(controller.active, id="f" * 64)
    assert cellctl("table", "verify", table, "--cell", cell) == 1
    assert "the one in force is ffffffffffff" in capsys.readouterr().out


def test_rollback_brings_the_table_before_back_and_a_second_one_undoes_it(cellctl, controller, table, cell, capsys):
    assert cellctl("table", "rollback", "--cell", cell) == 3
    for _ in range(2):
        cellctl("table", "push", table, "--cell", cell)
        first = TableFile.load(table).id
        rows = TableFile.load(table).rows[:5]
        remade(table, rows=rows)
    capsys.readouterr()
    assert controller.active.id == first
    assert cellctl("table", "rollback", "--cell", cell) == 0
    assert controller.previous.id == first
    assert cellctl("table", "rollback", "--cell", cell) == 0
    assert controller.active.id == first


def test_show_tells_what_the_controller_has(cellctl, controller, table, cell, capsys):
    assert cellctl("table", "show", "--cell", cell) == 0
    assert "in force   none" in capsys.readouterr().out
    cellctl("table", "push", table, "--cell", cell)
    capsys.readouterr()
    assert cellctl("table", "show", "--cell", cell, "--json", "-") == 0
    state = json.loads(capsys.readouterr().out)
    assert state["serial"] == "SIM-4711"
    assert state["active"] == {"id": TableFile.load(table).id, "rows": 8, "checksum": "89ABCDEF"}
    assert state["previous"] is None


def test_show_tells_what_is_in_a_file(cellctl, table, capsys):
    capsys.readouterr()
    assert cellctl("table", "show", table) == 0
    said = capsys.readouterr().out
    assert TableFile.load(table).id in said
    assert "a simulated controller, serial SIM-4711" in said
    assert cellctl("table", "show", table, "--json", "-") == 0
    assert json.loads(capsys.readouterr().out) == json.loads(table.read_text())


def test_show_asks_for_one_thing(cellctl, table, cell, capsys):
    assert cellctl("table", "show") == 2
    assert cellctl("table", "show", table, "--cell", cell) == 2


def test_a_cell_without_a_device_that_keeps_tables_is_refused(cellctl, controller, table, cell, folder, capsys):
    text = cell.read_text().replace("../robots", str(cell.parents[1] / "robots"))
    lines = [line for line in text.splitlines() if not line.strip().startswith(("robot:", "limits:"))]
    (folder / "cell.yaml").write_text("\n".join(lines))
    assert cellctl("table", "push", table, "--cell", "cell.yaml") == 2
    assert "no device that keeps tables" in capsys.readouterr().err


def shifted(table):
    """`table` with one joint of its second row a millionth of a degree off."""
    row = table.rows[1]
    off = TableRow(row.nominal, (row.compensated[0] + 1e-6, *row.compensated[1:]))
    return replace(table, rows=(table.rows[0], off, *table.rows[2:]))
