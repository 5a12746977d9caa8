"""Cells, procedures, check and start over the API."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from cellctl.console.jobs import Jobs
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import sha256_of
from cellctl.journal import Journal, RunStarted, SourceFile
from cellctl.operations.cell_devices import DeviceLocks
from tests.helpers.console import ApiClient, api_client
from tests.helpers.runs import CELL, cell_with

ADA = {"Authorization": "Bearer secret", "X-Operator": "Ada"}


@pytest.fixture
def client(tmp_path: Path) -> Iterator[ApiClient]:
    with api_client(tmp_path / "runs") as client:
        yield client


def test_a_cell_shows_the_devices_of_its_file_and_what_is_known_of_them(client: ApiClient) -> None:
    names = {one["name"]: one for one in client.get("/api/cells").json()}
    assert names["sphere_cell"]["simulated"] is True
    cell = client.get("/api/cells/sphere_cell").json()
    assert [device["name"] for device in cell["devices"]] == ["robot", "probe"]
    assert (cell["emergency_stop"], cell["source"]) == ("not known", "")
    refused = client.get("/api/cells/nothing")
    assert (refused.status_code, refused.json()["what"]) == (404, "there is no cell 'nothing'")


def test_devices_are_not_examined_while_a_run_is_active_on_the_cell(client: ApiClient, tmp_path: Path) -> None:
    source = SourceFile(str(CELL), CELL.read_text(), sha256_of(CELL.read_text()))
    with Journal.create(tmp_path / "runs" / "run-1", lambda: 0) as journal:
        journal.append(RunStarted(source, source, {}, 1, "lockstep", "me", "2026-01-02T03:04:05Z", "", {}))
        refused = client.post("/api/cells/sphere_cell/doctor", headers=ADA)
        assert client.get("/api/cells/sphere_cell").json()["run"] == "run-1"
    assert (refused.status_code, "run run-1 is active" in refused.json()["what"]) == (409, True)
    assert client.post("/api/cells/sphere_cell/doctor").status_code == 401


def test_a_procedure_shows_its_parameters_with_limits_and_units(client: ApiClient) -> None:
    assert "sphere_selfcal" in {one["name"] for one in client.get("/api/procedures").json()}
    form = client.get("/api/procedures/sphere_selfcal").json()
    speed = next(one for one in form["parameters"] if one["name"] == "search_speed")
    assert (speed["type"], speed["default"], speed["min"], speed["max"], speed["unit"]) == (
        "number",
        5,
        0.5,
        10,
        "mm/s",
    )
    assert client.get("/api/procedures/sphere").status_code == 404


@pytest.mark.parametrize(
    ("order", "code"),
    [
        ({"procedure": "../../etc/passwd"}, 404),
        ({"procedure": "sphere_selfcal", "cell": "no cell"}, 404),
        ({"procedure": "sphere_selfcal", "settings": {"--cell": "x"}}, 422),
        ({"procedure": "sphere_selfcal", "settings": {"touches_fit": "a\0b"}}, 422),
        ({"procedure": "sphere_selfcal", "seed": -1}, 422),
        ({}, 422),
    ],
)
def test_an_order_that_is_not_as_described_starts_nothing(
    client: ApiClient, tmp_path: Path, order: dict[str, object], code: int
) -> None:
    assert client.post("/api/runs", json=order, headers=ADA).status_code == code
    assert client.post("/api/runs", json={"procedure": "sphere_selfcal"}).status_code == 401
    assert not list((tmp_path / "runs").glob("*/"))


def test_a_second_run_on_a_real_cell_is_refused_while_one_is_active(
    client: ApiClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = cell_with(tmp_path)
    cell.write_text(cell.read_text().partition("\nsimulate:")[0])
    monkeypatch.chdir(tmp_path)
    drivers = DriverRegistry()
    with DeviceLocks.held(Cell.load(cell, drivers), drivers, run="run-1"):  # before its journal exists
        refused = client.post("/api/runs", json={"procedure": "sphere_selfcal", "cell": "cell"}, headers=ADA)
    assert (refused.status_code, "is in use by run run-1 (process" in refused.json()["what"]) == (409, True)
    assert not list((tmp_path / "runs").glob("*/"))


def test_a_run_on_a_real_cell_is_refused_while_a_table_is_changed(
    client: ApiClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = cell_with(tmp_path)
    cell.write_text(cell.read_text().partition("\nsimulate:")[0])
    monkeypatch.chdir(tmp_path)
    push = SimpleNamespace(operation="act_on_table", ended_already=False)
    monkeypatch.setattr(Jobs, "all", lambda _: [push])
    refused = client.post("/api/runs", json={"procedure": "sphere_selfcal", "cell": "cell"}, headers=ADA)
    assert (refused.status_code, refused.json()["cure"]) == (409, "start when that has ended")
    assert not list((tmp_path / "runs").glob("*/"))


@pytest.mark.long
def test_the_check_gives_errors_of_the_settings_before_anything_starts(client: ApiClient) -> None:
    order = {"procedure": "tool_at_point", "settings": {"no_such_parameter": 3}}
    found = client.post("/api/check", json=order, headers=ADA).json()
    assert [problem["file"] for problem in found["problems"]] == ["--set no_such_parameter=3"]
