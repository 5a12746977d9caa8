"""`cellctl table history` and `rollback --to`: what is recorded, by whom, and what a damaged record is worth."""

import getpass
import json
import shutil
from pathlib import Path

import pytest

from cellctl.devices import DeviceLost, DeviceUncertain
from cellctl.formats import TableFile
from cellctl.operations import table as table_module
from cellctl.operations.table_history import TableHistory

SERIAL = "SIM-4711"


@pytest.fixture
def cell(request):
    return request.config.rootpath / "procedures/cells/sphere_cell.yaml"


@pytest.fixture
def tables(table, folder):
    """Three table files for the controller, of 8, 5 and 3 rows; newest last."""
    whole = TableFile.load(table)
    found = [table]
    for count in (5, 3):
        part = whole.model_copy(update={"rows": whole.rows[:count]})
        found.append(folder / f"table_{count}.json")
        part.model_copy(update={"id": part.content_id()}).save(found[-1])
    return found


@pytest.fixture
def pushed(cellctl, controller, tables, cell, capsys):
    """The ids of the three tables, pushed one after the other."""
    for table in tables:
        assert cellctl("table", "push", table, "--cell", cell) == 0
    capsys.readouterr()
    return [TableFile.load(table).id for table in tables]


@pytest.fixture
def history(cellctl, folder):
    """The JSON of `table history`: of the only controller."""

    def shown(*options, code=0):
        assert cellctl("table", "history", *options, "--json", "history.json") == code
        [only] = json.loads((folder / "history.json").read_text())["controllers"]
        return only

    return shown


def test_each_table_is_listed_newest_first_with_who_when_and_from_which_model(pushed, history, tables):
    changes = history()["changes"]
    assert [change["table"] for change in changes] == pushed[::-1]
    assert [change["replaced"] for change in changes] == [pushed[1], pushed[0], None]
    assert [change["state"] for change in changes] == ["in force", "out of force", "out of force"]
    assert changes[1]["out_of_force"] == f"push of {pushed[2][:12]}"
    assert changes[1]["until"] == changes[0]["time"]
    file = TableFile.load(tables[2])
    newest = changes[0]
    assert newest["who"].startswith(f"{getpass.getuser()}@")
    assert (newest["rows"], newest["model_sha256"], newest["method"]) == (3, file.source.model_sha256, "pseudo-target")
    assert newest["max_correction_deg"] == pytest.approx(file.max_correction_deg)
    assert newest["action"] == "push"


def test_the_history_names_table_user_and_state_on_the_terminal(cellctl, pushed, capsys):
    assert cellctl("table", "history", "--serial", SERIAL) == 0
    shown = capsys.readouterr().out
    assert shown.index(pushed[2][:12]) < shown.index(pushed[1][:12]) < shown.index(pushed[0][:12])
    assert f"push, {getpass.getuser()}@" in shown


def test_any_table_of_the_history_comes_back_by_the_beginning_of_its_id(
    cellctl, controller, pushed, tables, cell, history
):
    for table in tables:
        table.unlink()
    assert cellctl("table", "rollback", "--cell", cell, "--to", pushed[0][:8]) == 0
    assert controller.active.id == pushed[0]
    newest = history()["changes"][0]
    assert (newest["action"], newest["table"], newest["replaced"]) == ("rollback", pushed[0], pushed[2])


def test_a_rollback_to_the_table_before_is_recorded(cellctl, controller, pushed, cell, history):
    assert cellctl("table", "rollback", "--cell", cell) == 0
    newest, before = history()["changes"][:2]
    assert (newest["action"], newest["table"], newest["rows"]) == ("rollback", pushed[1], 5)
    assert before["out_of_force"] == f"rollback to {pushed[1][:12]}"


def test_a_rollback_to_no_table_is_recorded(cellctl, controller, table, cell, history):
    assert cellctl("table", "push", table, "--cell", cell) == 0
    assert cellctl("table", "rollback", "--cell", cell) == 0
    newest = history("--cell", cell)["changes"][0]
    assert (newest["table"], newest["state"]) == (None, "in force")


def test_an_unknown_id_is_refused_and_the_tables_there_are_are_listed(cellctl, controller, pushed, cell, capsys):
    assert cellctl("table", "rollback", "--cell", cell, "--to", "0123") == 2
    shown = capsys.readouterr().err
    assert "0123: is the id of no table in this history" in shown
    assert all(table_id[:12] in shown for table_id in pushed)
    assert "nothing was written" in shown
    assert controller.active.id == pushed[2]


def test_an_ambiguous_id_is_refused_and_its_candidates_are_listed(cellctl, controller, pushed, cell, capsys, folder):
    twin = pushed[0][:6] + "f" * 58
    shutil.copy(copy_of(pushed[0]), copy_of(twin))
    assert cellctl("table", "rollback", "--cell", cell, "--to", pushed[0][:6]) == 2
    shown = capsys.readouterr().err
    assert "is the beginning of 2 tables' ids" in shown
    assert pushed[0][:12] in shown
    assert twin[:12] in shown
    assert pushed[1][:12] not in shown


def test_a_changed_copy_is_not_pushed(cellctl, controller, pushed, cell, capsys):
    content = json.loads(copy_of(pushed[0]).read_text())
    content["rows"][0]["compensated"][0] += 0.1
    copy_of(pushed[0]).write_text(json.dumps(content))
    assert cellctl("table", "rollback", "--cell", cell, "--to", pushed[0]) == 2
    shown = capsys.readouterr().err
    assert "was changed after it was made" in shown
    assert str(copy_of(pushed[0])) in shown
    assert controller.active.id == pushed[2]


def test_a_copy_of_another_table_under_this_name_is_not_pushed(cellctl, controller, pushed, cell, capsys):
    shutil.copy(copy_of(pushed[1]), copy_of(pushed[0]))
    assert cellctl("table", "rollback", "--cell", cell, "--to", pushed[0]) == 2
    assert "not the one of its name" in capsys.readouterr().err
    assert controller.active.id == pushed[2]


def test_a_table_of_the_history_is_refused_by_a_cell_with_another_robot(cellctl, controller, pushed, cell, capsys):
    table = TableFile.load(copy_of(pushed[0]))
    other = table.model_copy(update={"robot": table.robot.model_copy(update={"name": "KUKA KR16"})})
    other = other.model_copy(update={"id": other.content_id()})
    other.save(copy_of(other.id))
    assert cellctl("table", "rollback", "--cell", cell, "--to", other.id) == 2
    assert "it is for a 'KUKA KR16'" in capsys.readouterr().err
    assert controller.active.id == pushed[2]


def test_a_line_that_cannot_be_read_is_named_and_the_others_are_shown(cellctl, pushed, history, capsys):
    file = history_file()
    lines = file.read_text().splitlines()
    lines[2] = lines[2].replace('"action":"push"', '"action":"pull"')
    file.write_text("\n".join([*lines, '{"kind":"beg']))  # changed by hand; and cut off by a crash
    found = history()
    assert [change["table"] for change in found["changes"]] == [pushed[2], pushed[0]]
    assert found["unreadable"] == [f"{file}:3", f"{file}:{len(lines) + 1}"]
    assert f"{file}:3: this line of the history cannot be read: begin.action" in capsys.readouterr().err


def test_after_a_line_that_was_cut_off_the_next_change_is_recorded_whole(cellctl, pushed, tables, cell, history):
    with history_file().open("a") as stream:
        stream.write('{"kind":"beg')
    assert cellctl("table", "rollback", "--cell", cell) == 0
    found = history()
    assert found["changes"][0]["table"] == pushed[1]
    assert len(found["unreadable"]) == 1


@pytest.mark.parametrize(
    ("error", "code", "state"),
    [
        (DeviceUncertain("robot", "the connection was lost at the activation"), 4, "uncertain"),
        (DeviceLost("robot", "the connection was lost; the old table is in force"), 3, "not in force"),
    ],
)
def test_how_a_push_failed_is_recorded(cellctl, controller, pushed, table, cell, history, error, code, state):
    controller.failing = error
    assert cellctl("table", "push", table, "--cell", cell) == code
    newest, before = history()["changes"][:2]
    assert (newest["table"], newest["state"], newest["reason"]) == (pushed[0], state, error.what)
    assert (before["state"] == "in force") == (state == "not in force")


def test_a_push_that_was_killed_is_uncertain_until_the_controller_is_asked_by_the_next_change(
    cellctl, controller, pushed, tables, cell, history
):
    file = history_file()
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))  # no end of the last push
    assert history()["changes"][0]["state"] == "uncertain"
    assert cellctl("table", "rollback", "--cell", cell) == 0
    changes = history()["changes"]
    assert [change["state"] for change in changes] == ["in force", "out of force", "out of force", "out of force"]
    assert "the controller reported later" in changes[1]["reason"]


def test_a_table_that_was_loaded_by_something_else_is_pointed_out(cellctl, controller, pushed, cell, history, capsys):
    assert history("--cell", cell)["difference"] is None
    controller.active = controller.previous
    found = history("--cell", cell, code=1)
    assert f"{pushed[1][:12]} in force, the record says {pushed[2][:12]}" in found["difference"]
    assert found["controller"]["active"]["id"] == pushed[1]
    assert "Not as recorded" in capsys.readouterr().out


def test_a_table_that_something_else_replaced_has_no_recorded_end(cellctl, controller, pushed, tables, cell, history):
    controller.active = None
    assert cellctl("table", "push", tables[0], "--cell", cell) == 0
    change = history()["changes"][1]
    found = "the controller had no table in force before the next change"
    assert change["out_of_force"] == f"changed outside of cellctl: {found}"


@pytest.mark.parametrize("where", ["begin", "copy"])
def test_a_full_disk_does_not_keep_a_table_from_the_controller(
    cellctl, controller, table, cell, capsys, monkeypatch, folder, where
):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(table_module, {"begin": "append_line", "copy": "write_atomically"}[where], full)
    assert cellctl("table", "push", table, "--cell", cell, "--json", "pushed.json") == 0
    shown = capsys.readouterr()
    assert "is in force on SIM-4711" in shown.out
    assert "the history of tables was not written: No space left on device" in shown.err
    assert json.loads((folder / "pushed.json").read_text())["recorded"] is False
    assert controller.active.id == TableFile.load(table).id


def test_a_folder_of_runs_that_cannot_be_made_does_not_keep_a_table_from_the_controller(
    cellctl, controller, table, cell, capsys, folder
):
    (folder / "runs").write_text("a file")
    assert cellctl("table", "push", table, "--cell", cell) == 0
    assert "the history of tables was not written" in capsys.readouterr().err
    assert controller.active.id == TableFile.load(table).id


def test_a_serial_that_is_no_folder_name_has_its_own_folder(cellctl, controller, table, cell, history, folder):
    assert TableHistory(folder, "../../etc").folder.parent == folder / "tables"
    assert TableHistory(folder, "..").folder.parent == folder / "tables"
    assert TableHistory(folder, "..").folder.name != ".."
    assert len({TableHistory(folder, serial).folder for serial in ("a/b", "a%2Fb", "a b", "ab")}) == 4


def test_runs_lists_no_run_where_there_are_only_tables(cellctl, pushed, capsys):
    assert cellctl("runs") == 0
    assert "No runs in runs" in capsys.readouterr().out


def test_show_takes_the_id_of_a_table_of_the_history(cellctl, pushed, tables, capsys):
    for table in tables:
        table.unlink()
    assert cellctl("table", "show", pushed[1][:10]) == 0
    assert pushed[1] in capsys.readouterr().out
    assert cellctl("table", "show", "0123") == 2
    assert pushed[1][:12] in capsys.readouterr().err


def test_an_empty_history_says_what_makes_an_entry(cellctl, folder, capsys):
    assert cellctl("table", "history") == 0
    assert "No table is recorded in runs" in capsys.readouterr().err


def test_a_serial_without_tables_shows_which_controllers_have_some(cellctl, pushed, capsys):
    assert cellctl("table", "history", "--serial", "925185") == 0
    shown = capsys.readouterr()
    assert "Controller 925185: no table is recorded" in shown.out
    assert "controllers SIM-4711" in shown.err


def test_verify_takes_the_id_of_a_table_of_the_history(cellctl, controller, pushed, cell):
    assert cellctl("table", "verify", pushed[2][:10], "--cell", cell) == 0
    assert cellctl("table", "verify", pushed[1][:10], "--cell", cell) == 1


def test_a_serial_that_is_not_the_cells_is_refused(cellctl, controller, pushed, cell, capsys):
    assert cellctl("table", "history", "--cell", cell, "--serial", "925185") == 2
    assert "'SIM-4711'" in capsys.readouterr().err


def history_file():
    return TableHistory(Path("runs"), SERIAL).file


def copy_of(table_id):
    return TableHistory(Path("runs"), SERIAL).copy_of(table_id)
