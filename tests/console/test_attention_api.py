"""Events, alarms, the overview and the queue over the API, with an in-process client."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from cellctl.console import commands, queue_commands, watching
from cellctl.console.shared import console
from cellctl.journal import host_of
from cellctl.operations.checking import Checked
from cellctl.operations.run_control import RunOrder
from tests.helpers.console import ApiClient, api_client
from tests.helpers.engine import WrittenRun, registry
from tests.helpers.journals import SPHERE_CELL, run_in
from tests.helpers.runs import quick_cell

ADA = {"Authorization": "Bearer secret", "X-Operator": "Ada"}
ORDER = {"procedure": "sphere_selfcal", "cell": "sphere_cell", "settings": {"search_speed": 4, "points": 30}}
PATIENCE_S = 60.0


@pytest.fixture
def client(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ApiClient]:
    monkeypatch.setattr(watching, "TICK_S", 0.02)

    async def ready() -> None:
        while console().watch._states is None:  # what has ended before is not followed by events
            await asyncio.sleep(0.01)

    with api_client(tmp_path, registry) as client:
        client.done(ready())
        yield client


@pytest.fixture
def orders(client: ApiClient, monkeypatch: pytest.MonkeyPatch) -> list[RunOrder]:
    """The orders of runs that were started; nothing is checked, and a started run is only written down."""
    found: list[RunOrder] = []

    async def start(operator: Any, order: RunOrder) -> str:
        found.append(order)
        return f"run-{len(found)}"

    async def check(*_: Any) -> Checked:
        return Checked(())

    monkeypatch.setattr(commands, "start", start)
    monkeypatch.setattr(queue_commands, "check", check)
    return found


def until(client: ApiClient, path: str, true: Callable[[Any], object]) -> Any:
    async def asked() -> Any:
        async with asyncio.timeout(PATIENCE_S):
            while not true(found := client.get(path).json()):
                await asyncio.sleep(0.02)
            return found

    return asyncio.run(asked())


def events(answer: httpx.Response) -> list[tuple[str, str, dict[str, Any]]]:
    """Id, kind and data of each event of a stream."""
    assert answer.headers["content-type"].startswith("text/event-stream")
    found = []
    for part in answer.text.strip().split("\n\n"):
        fields = dict(line.split(": ", 1) for line in part.split("\n"))
        found.append((fields["id"], fields["event"], json.loads(fields["data"])))
    return found


def test_events_are_read_without_a_token_and_resumed_by_the_last_id(client: ApiClient, tmp_path: Path) -> None:
    ((first, kind, _),) = events(client.get("/api/events?wait=false"))
    assert kind == "reset"
    WrittenRun(tmp_path / "a").end("failed")
    until(client, "/api/alarms", lambda alarms: alarms)
    found = events(client.get("/api/events?wait=false", headers={"Last-Event-ID": first}))
    assert {"run_ended", "alarm_raised"} <= {kind for _, kind, _ in found}
    ids = [number for number, *_ in found]
    again = events(client.get("/api/events?wait=false", headers={"Last-Event-ID": ids[-2]}))
    assert [number for number, *_ in again] == ids[-1:]
    ((_, kind, _),) = events(client.get("/api/events?wait=false", headers={"Last-Event-ID": f"old-{ids[-2]}"}))
    assert kind == "reset"


def test_too_many_programs_that_read_events_are_refused(client: ApiClient) -> None:
    stream = console().watch.events
    stream.clients += 64
    refused = client.get("/api/events?wait=false")
    assert (refused.status_code, "64 programs" in refused.json()["what"]) == (429, True)


def test_an_alarm_is_acknowledged_by_name_once_and_the_audit_log_has_it(client: ApiClient, tmp_path: Path) -> None:
    WrittenRun(tmp_path / "a").end("uncertain")
    (alarm,) = until(client, "/api/alarms?standing=true", lambda alarms: alarms)
    path = f"/api/alarms/{alarm['id']}/acknowledge"
    assert client.post(path, json={}).status_code == 401
    seen = client.post(path, json={"words": "looked: it is clear"}, headers=ADA).json()
    assert (seen["by"], seen["words"], seen["why"]) == ("Ada", "looked: it is clear", "acknowledged")
    again = client.post(path, json={}, headers=ADA)
    assert (again.status_code, "acknowledged by Ada" in again.json()["what"]) == (409, True)
    assert client.post("/api/alarms/x/acknowledge", json={}, headers=ADA).status_code == 404
    assert client.get("/api/alarms?standing=true").json() == []
    assert [line["command"] for line in client.get("/api/audit").json()] == ["acknowledge"] * 3


def test_the_overview_has_each_cell_with_its_run_last_verdict_and_age_of_calibration(
    client: ApiClient, tmp_path: Path
) -> None:
    run_in(tmp_path, "old", "2026-11-01", "SIM-925185", cell=str(SPHERE_CELL.with_suffix("")))
    run = WrittenRun(tmp_path / "a")
    cells = until(client, "/api/overview", lambda cells: cells[0]["run"] and cells[1]["last_run"])
    active, sphere = cells[0], cells[1]
    assert (active["name"], active["run"], active["state"], active["total"]) == ("cell", "a", "running", 4)
    assert (active["simulated"], active["offered"], active["host"]) == (False, False, host_of(tmp_path / "a"))
    assert (sphere["name"], sphere["simulated"], sphere["offered"]) == ("sphere_cell", True, True)
    assert (sphere["last_verdict"], sphere["calibrated_by"], sphere["due"]) == ("better", "old", False)
    run.end()
    until(client, "/api/overview", lambda cells: not any(cell["run"] for cell in cells))


def test_a_queued_run_is_offered_confirmed_by_name_and_started_once(client: ApiClient, orders: list[RunOrder]) -> None:
    assert client.post("/api/queue", json=ORDER).status_code == 401
    entry = client.post("/api/queue", json=ORDER, headers=ADA).json()
    path = f"/api/queue/{entry['id']}"
    until(client, "/api/queue", lambda found: found[0]["state"] == "offered")
    assert orders == []  # nothing starts by itself
    assert client.post(f"{path}/confirm").status_code == 401
    assert client.post(f"{path}/confirm", headers=ADA).json() == {"run": "run-1"}
    (order,) = orders
    assert (order.procedure.stem, order.cell, set(order.settings)) == (
        "sphere_selfcal",
        SPHERE_CELL,
        {"search_speed=4", "points=30"},
    )
    again = client.post(f"{path}/confirm", headers=ADA)
    assert (again.status_code, "it is started" in again.json()["what"]) == (409, True)
    (entry,) = client.get("/api/queue").json()
    assert (entry["run"], entry["who"], entry["by"]) == ("run-1", "Ada", "Ada")
    assert client.delete(path, headers=ADA).status_code == 409
    assert client.post("/api/queue/x/confirm", headers=ADA).status_code == 404
    assert client.post("/api/queue/x/offer", headers=ADA).status_code == 404


def test_a_schedule_is_added_with_the_procedures_cell_and_removed(client: ApiClient, orders: list[RunOrder]) -> None:
    timed = {"procedure": "daily_check", "time": "06:00", "weekdays": [1, 2]}
    made = client.post("/api/schedules", json=timed, headers=ADA).json()
    assert (made["planned"]["cell"], made["time"], made["weekdays"]) == ("tracker_cell", "06:00", [1, 2])
    for wrong in ({**timed, "time": "6 o'clock"}, {**timed, "weekdays": []}, {**timed, "procedure": "x"}):
        assert client.post("/api/schedules", json=wrong, headers=ADA).status_code == 422
    assert client.get("/api/schedules").json() == [made]
    assert client.delete(f"/api/schedules/{made['id']}", headers=ADA).status_code == 204
    assert client.get("/api/schedules").json() == []


def test_a_run_of_another_host_is_not_commanded_from_here(client: ApiClient, tmp_path: Path) -> None:
    run = WrittenRun(tmp_path / "a")
    lock = tmp_path / "a" / "journal.lock"
    lock.write_text("\n".join([*lock.read_text().split("\n")[:3], "hall-7-pc", ""]))  # as that host writes it
    for command, content in (("pause", {}), ("abort", {}), ("confirm", {"step": "clear"}), ("retry", {})):
        refused = client.post(f"/api/runs/a/{command}", json=content, headers=ADA)
        assert (refused.status_code, refused.json()["cure"]) == (409, "use the console on hall-7-pc")
    run.end()


def test_a_real_cell_of_another_host_is_not_commanded_from_here(tmp_path: Path) -> None:
    """That host is the one of the last run on the cell: no run starts here, and no device is connected."""
    runs, real = tmp_path / "runs", tmp_path / "hall8.yaml"
    quick_cell(tmp_path, name="hall8.yaml")
    real.write_text(real.read_text().partition("\nsimulate:")[0])
    run_in(runs, "a", "2026-11-01", "925185", cell=str(real.with_suffix("")))
    lock = runs / "a" / "journal.lock"
    lock.write_text("\n".join([*lock.read_text().split("\n")[:3], "hall-8-pc", ""]))
    order = {"procedure": "sphere_selfcal", "cell": "hall8", "settings": {}}
    with api_client(runs, registry, cell=real) as client:
        until(client, "/api/runs", bool)
        for path, content in (
            ("/api/runs", order),
            ("/api/cells/hall8/doctor", {}),
            ("/api/tables/look", {"action": "verify", "cell": str(real)}),
        ):
            refused = client.post(path, json=content, headers=ADA)
            assert refused.status_code in (409, 422), (path, refused.json())
            assert "this cell is of hall-8-pc (run a)" in refused.text
            assert "use the console on hall-8-pc" in refused.text
