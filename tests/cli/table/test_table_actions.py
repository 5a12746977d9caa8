"""Tables from the console: the difference first, a typed confirmation, and what is refused."""

import shutil

import pytest

from cellctl.files import InputError
from cellctl.formats import TableFile
from cellctl.operations import table_actions
from cellctl.operations.results import as_json, from_json
from cellctl.operations.table_actions import TableRequest, act, look
from cellctl.operations.table_history import TableHistory

SERIAL = "SIM-4711"


@pytest.fixture
def tables(table, folder):
    """A whole table and one of its first three rows; each in the folder of a run."""
    whole = TableFile.load(table)
    part = whole.model_copy(update={"rows": whole.rows[:3]})
    part = part.model_copy(update={"id": part.content_id()})
    for name, each in (("first", whole), ("second", part)):
        (folder / "runs" / name).mkdir(parents=True)
        each.save(folder / "runs" / name / "table.json")
    return [whole.id, part.id]


@pytest.fixture
def asked(request, folder, controller):
    """A request about the shipped cell, in whose place the test's controller stands."""

    def of(action, table="", **more):
        cell = request.config.rootpath / "procedures/cells/sphere_cell.yaml"
        return TableRequest(action, cell, folder / "runs", table, who="Kim@hall", **more)

    return of


@pytest.fixture
def pushed(asked, tables):
    """Both tables, one after the other."""
    act(asked("push", tables[0], confirmed=SERIAL))
    act(asked("push", tables[1], seen=tables[0], confirmed=tables[1][:8]))
    return tables


def test_a_push_by_its_runs_table_is_recorded_with_the_person_and_the_table_before(pushed, folder, controller):
    entries, _ = TableHistory(folder / "runs", SERIAL).read()
    assert [entry.begin.who for entry in entries] == ["Kim@hall", "Kim@hall"]
    assert (entries[1].begin.table, entries[1].begin.replaced) == (pushed[1], pushed[0])
    assert controller.active.id == pushed[1]


def test_the_difference_is_shown_without_a_change(asked, pushed, controller):
    found = look(asked("push", pushed[0]))
    assert (found.serial, found.target, found.refused) == (SERIAL, pushed[0], [])
    assert (found.difference.matched, found.difference.only_b) == (3, [4, 5, 6, 7, 8])
    assert controller.active.id == pushed[1]


def test_a_rollback_shows_and_restores_the_table_before(asked, pushed, controller):
    found = look(asked("rollback"))
    assert (found.target, found.difference.matched) == (pushed[0], 3)
    act(asked("rollback", seen=pushed[1], confirmed=SERIAL))
    assert controller.active.id == pushed[0]


def test_a_rollback_to_a_table_of_the_history_is_recorded_as_one(asked, pushed, controller, folder):
    act(asked("rollback", pushed[0], seen=pushed[1], confirmed=SERIAL))
    assert controller.active.id == pushed[0]
    assert TableHistory(folder / "runs", SERIAL).read()[0][-1].begin.action == "rollback"


def test_verify_compares_and_needs_no_confirmation(asked, pushed):
    assert act(asked("verify", pushed[1])).same is True
    assert act(asked("verify", pushed[0])).same is False


@pytest.mark.parametrize("typed", ["", "SIM-471", "deadbeef"])
def test_without_the_right_confirmation_nothing_is_written(asked, pushed, controller, typed):
    for action, table in (("push", pushed[0]), ("rollback", "")):
        with pytest.raises(InputError, match="confirmation"):
            act(asked(action, table, seen=pushed[1], confirmed=typed))
    assert controller.active.id == pushed[1]


def test_a_change_against_another_table_than_was_seen_is_refused(asked, pushed, controller):
    with pytest.raises(InputError, match="you were shown"):
        act(asked("push", pushed[0], seen=pushed[0], confirmed=SERIAL))
    assert controller.active.id == pushed[1]


def test_nothing_is_connected_while_a_run_is_active_on_the_cell(asked, tables, controller, monkeypatch):
    monkeypatch.setattr(table_actions, "run_on", lambda cell, runs: "sphere-1")
    for work in (look, act):
        with pytest.raises(InputError, match="run sphere-1 is active on this cell"):
            work(asked("push", tables[0], confirmed=SERIAL))
    assert controller.connections == 0


@pytest.mark.parametrize("name", ["", "../../table", "0" * 64])
def test_a_table_that_is_not_here_is_refused(asked, tables, name, controller):
    with pytest.raises(InputError, match="table"):
        act(asked("push", name, confirmed=SERIAL))
    assert controller.connections == 0


def test_a_table_that_was_changed_is_refused(asked, tables, folder, controller):
    place = folder / "runs" / "tables" / SERIAL
    place.mkdir(parents=True)
    shutil.copy(folder / "runs" / "first" / "table.json", place / f"{tables[1]}.json")
    with pytest.raises(InputError, match="not the one of its name"):
        act(asked("push", tables[1], confirmed=SERIAL))
    assert controller.connections == 0


def test_a_request_goes_through_json(asked, tables):
    found = asked("push", tables[0], seen="", confirmed=SERIAL, state=None, seed=3)
    assert from_json(TableRequest, as_json(found)) == found
