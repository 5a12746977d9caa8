"""The API of tables: histories, differences, and the commands' refusals; no device is needed for these."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.console.commands import all_audited
from cellctl.console.shared import console
from cellctl.formats import TableFile
from cellctl.operations.table import TableRecorder
from cellctl.operations.table_history import TableHistory
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv
from tests.helpers.console import TOKEN, ApiClient, api_client
from tests.helpers.journals import run_in

SERIAL = "SIM-4711"
CELL = Path(__file__).parents[2] / "procedures" / "cells" / "sphere_cell.yaml"
COMMAND = {"Authorization": f"Bearer {TOKEN}", "X-Operator": "Kim"}


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A folder with a run that made a table, a shorter table put in force later, and their ids."""
    runs = tmp_path_factory.mktemp("tables") / "runs"
    runs.mkdir()
    place = run_in(runs, "sphere-1", "2026-11-01", SERIAL)
    kr5_model().save(place / "model.json")
    (place / "targets.csv").write_text(targets_csv(readings_near_the_middle(8)))
    files = [place / "model.json", place / "targets.csv", "--serial", SERIAL, "-o", place / "table.json"]
    words = ["compensate", *map(str, files)]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 0
    whole = TableFile.load(place / "table.json")
    part = whole.model_copy(update={"rows": whole.rows[:3]})
    part = part.model_copy(update={"id": part.content_id()})
    with TableRecorder(TableHistory(runs, SERIAL), who="Kim@hall").change("push", part, None):
        pass
    return runs, [whole.id, part.id]


@pytest.fixture(scope="module")
def client(tables: tuple[Path, list[str]]) -> Iterator[ApiClient]:
    with api_client(tables[0], cell=CELL) as found:
        yield found


def test_a_controllers_history_and_the_tables_for_it_are_read_without_a_token(
    client: ApiClient, tables: tuple[Path, list[str]]
) -> None:
    (found,) = client.get("/api/tables").json()
    assert found == client.get(f"/api/tables/{SERIAL}").json()
    assert (found["changes"][0]["table"], found["changes"][0]["who"]) == (tables[1][1], "Kim@hall")
    assert {table["id"] for table in found["tables"]} == set(tables[1])
    assert client.get("/api/tables/925185").json()["cure"] == f"recorded controllers: {SERIAL}"


def test_two_tables_are_compared_by_their_ids(client: ApiClient, tables: tuple[Path, list[str]]) -> None:
    found = client.get("/api/tables/diff", params={"a": tables[1][1], "b": tables[1][0]}).json()
    assert (found["matched"], found["only_b"]) == (3, [4, 5, 6, 7, 8])
    for name in ("../../sphere-1/table", tables[1][0][:12], "0" * 64):
        assert client.get("/api/tables/diff", params={"a": name, "b": tables[1][0]}).status_code == 422


def test_looking_and_acting_need_the_token(client: ApiClient) -> None:
    for path in ("look", "act"):
        body = {"action": "rollback", "confirmed": SERIAL}
        assert client.post(f"/api/tables/{path}", json=body).status_code == 401


def test_a_change_without_a_confirmation_or_with_an_unknown_memory_is_refused(client: ApiClient) -> None:
    assert client.post("/api/tables/act", json={"action": "rollback"}, headers=COMMAND).status_code == 422
    body = {"action": "rollback", "confirmed": SERIAL, "state": "../elsewhere"}
    assert client.post("/api/tables/act", json=body, headers=COMMAND).status_code == 422


@pytest.mark.long
def test_a_refused_action_ends_in_the_audit_log_with_its_reason(client: ApiClient) -> None:
    body = {"action": "verify", "table": "0" * 64, "confirmed": ""}
    job = client.post("/api/tables/act", json=body, headers=COMMAND).json()["job"]
    found = console().jobs.find(job)
    assert found
    client.done(all_audited())
    assert "is the id of no table here" in str(found.failure)
    (line, *_) = client.get("/api/audit").json()
    assert (line["command"], line["operator"], line["outcome"]) == ("table verify", "Kim", "failed")
    assert "is the id of no table here" in line["reason"]


@pytest.mark.long
def test_a_change_is_refused_at_once_unless_it_is_confirmed_as_a_look_at_the_controller_asked_for_it(
    client: ApiClient, tables: tuple[Path, list[str]]
) -> None:
    def acted(action: str, confirmed: str) -> tuple[int, str, str]:
        body = {"action": action, "table": asked["table"] if action == "push" else "", "confirmed": confirmed}
        answer = client.post("/api/tables/act", json=body, headers=COMMAND)
        return answer.status_code, answer.json()["problems"][0]["file"], answer.json()["what"]

    asked = {"action": "push", "table": tables[1][0]}
    number = client.post("/api/tables/look", json=asked, headers=COMMAND).json()["job"]
    look = console().jobs.find(number)
    assert look
    client.done(look.ended())
    for typed in ("", "SIM-000000", asked["table"][:7], tables[1][1]):
        assert acted("push", typed) == (422, "confirmation", "is not the serial or the table")
    assert acted("rollback", look.result["serial"]) == (422, "controller", "was not looked at for this change")
    assert "push" not in " ".join(job.title for job in console().jobs.all() if job.operation == "act_on_table")
    (line, *_) = client.get("/api/audit").json()
    assert (line["command"], line["outcome"]) == ("table rollback", "failed")
