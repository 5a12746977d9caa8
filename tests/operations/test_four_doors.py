"""Command line, API, pages and Python lead to the same services: each gives the same answer by every door that it has.

Of a page it is the data that it draws.
"""

from __future__ import annotations

import asyncio
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

import cellctl
from cellctl.console.commands import found_rows
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.formats import TableFile
from cellctl.installed import shipped
from cellctl.operations import analyses
from cellctl.operations.cell_state import examine_cell, last_examination
from cellctl.operations.comparing_runs import compare_runs, parameter_drift
from cellctl.operations.results import as_json
from cellctl.operations.run_indexing import run_rows
from cellctl.operations.table import TableRecorder
from cellctl.operations.table_history import TableHistory, table_overview
from tests.helpers.arms import cellctl as command
from tests.helpers.arms import kr5_model, readings_near_the_middle, targets_csv
from tests.helpers.console import TOKEN, ApiClient, api_client
from tests.helpers.journals import run_in
from tests.helpers.krl import usual_seam

INPUTS = Path(__file__).parents[1] / "golden" / "inputs"
SERIAL = "SIM-4711"
RUNS = ("sphere-1", "sphere-2")
COMMANDER = {"Authorization": f"Bearer {TOKEN}", "X-Operator": "Ada"}


@dataclass(frozen=True)
class Doors:
    """The command line and the API over one folder of runs. tables: ids, of all rows and of the first three."""

    runs: Path
    client: ApiClient
    tables: tuple[str, str]

    def by_command(self, *words: object) -> Any:
        """The JSON of a command."""
        file = self.runs.parent / "answer.json"
        file.unlink(missing_ok=True)
        command(*map(str, words), "--json", str(file))
        return json.loads(file.read_text())

    def by_api(self, path: str, **query: str) -> Any:
        """The JSON of a route."""
        answer = self.client.get(f"/api/{path}", params=query)
        assert answer.status_code == 200, answer.text
        return answer.json()


@pytest.fixture(scope="module")
def doors(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Doors]:
    """Two runs with models; a table of the first, then a shorter one, were put in force."""
    runs = tmp_path_factory.mktemp("doors") / "runs"
    runs.mkdir()
    for day, name in enumerate(RUNS, 1):
        kr5_model().save(run_in(runs, name, f"2026-11-0{day}", SERIAL) / "model.json")
    place = runs / RUNS[0]
    (place / "targets.csv").write_text(targets_csv(readings_near_the_middle(8)))
    made = place / "table.json"
    command("compensate", str(place / "model.json"), str(place / "targets.csv"), "--serial", SERIAL, "-o", str(made))
    whole = TableFile.load(made)
    part = whole.model_copy(update={"rows": whole.rows[:3]})
    part = part.model_copy(update={"id": part.content_id()})
    recorder = TableRecorder(TableHistory(runs, SERIAL), who="Kim@hall")
    for table, replaced in ((whole, None), (part, whole.id)):
        with recorder.change("push", table, replaced):
            pass
    with api_client(runs) as client:
        yield Doors(runs, client, (whole.id, part.id))


def without_empty(row: dict[str, Any]) -> dict[str, Any]:
    """Without the fields that the API gives to every run."""
    return {name: value for name, value in row.items() if value is not None}


def test_runs(doors: Doors) -> None:
    listed = [without_empty(row) for row in doors.by_command("runs", "--runs", doors.runs)["runs"]]
    assert [row["run"] for row in listed] == list(reversed(RUNS))
    assert [without_empty(row) for row in doors.by_api("runs")] == listed
    assert [without_empty(as_json(row)) for row in doors.client.done(found_rows())] == listed


@pytest.mark.parametrize("name", RUNS)
def test_one_run(doors: Doors, name: str) -> None:
    shown = without_empty(doors.by_command("show", name, "--runs", doors.runs))
    assert shown["verdict"] == "better"
    assert without_empty(doors.by_api(f"runs/{name}/result")) == shown
    assert without_empty(json.loads(json.dumps(cellctl.open_run(name, doors.runs).report))) == shown


def test_two_runs_compared(doors: Doors) -> None:
    compared = doors.by_command("show", RUNS[0], "--against", RUNS[1], "--runs", doors.runs)
    assert doors.by_api("compare", a=RUNS[0], b=RUNS[1]) == compared
    assert as_json(compare_runs(*(doors.runs / name for name in RUNS))) == compared


def test_the_drift_of_a_robots_parameters(doors: Doors) -> None:
    by_api = doors.by_api("drift", serial=SERIAL)
    assert [each["run"] for each in by_api["runs"]] == list(RUNS)
    assert as_json(parameter_drift(doors.runs, run_rows(doors.runs), SERIAL)) == by_api


def test_the_history_of_a_controllers_tables(doors: Doors) -> None:
    [controller] = doors.by_command("table", "history", "--runs", doors.runs)["controllers"]
    assert [change["table"] for change in controller["changes"]] == [doors.tables[1], doors.tables[0]]
    [by_api] = doors.by_api("tables")
    assert (by_api["serial"], by_api["changes"]) == (controller["serial"], controller["changes"])
    assert doors.by_api(f"tables/{SERIAL}") == by_api
    assert [as_json(each) for each in table_overview(doors.runs)] == [by_api]
    table = cellctl.open_run(RUNS[0], doors.runs).table
    assert table
    assert table.id in {each["id"] for each in by_api["tables"]}


def test_the_difference_of_two_tables(doors: Doors) -> None:
    by_command = doors.by_command("table", "diff", doors.tables[0][:12], doors.tables[1][:12], "--runs", doors.runs)
    assert (by_command["matched"], by_command["only_a"]) == (3, [4, 5, 6, 7, 8])
    assert doors.by_api("tables/diff", a=doors.tables[0], b=doors.tables[1]) == by_command


def test_predictions(doors: Doors, tmp_path: Path) -> None:
    place = doors.runs / RUNS[0]
    command("predict", str(place / "model.json"), str(place / "targets.csv"), "-o", str(tmp_path / "by_command.csv"))
    cellctl.load(place / "model.json").predict(place / "targets.csv").to_csv(tmp_path / "by_python.csv")
    assert (tmp_path / "by_command.csv").read_text().count("\n") == 9
    assert (tmp_path / "by_python.csv").read_bytes() == (tmp_path / "by_command.csv").read_bytes()


def test_compensated_targets(doors: Doors, tmp_path: Path) -> None:
    place = doors.runs / RUNS[0]
    command("compensate", str(place / "model.json"), str(place / "targets.csv"), "-o", str(tmp_path / "by_command.csv"))
    found = cellctl.load(place / "model.json").compensate(place / "targets.csv")
    assert found.reached.all()
    found.to_csv(tmp_path / "by_python.csv")
    assert (tmp_path / "by_python.csv").read_bytes() == (tmp_path / "by_command.csv").read_bytes()


@pytest.mark.long
def test_a_compensated_program(doors: Doors, tmp_path: Path) -> None:
    """Command line, Python and API: the same files, the same figures."""
    place, given = doors.runs / RUNS[0], tmp_path / "given"
    given.mkdir()
    usual_seam().write(given)
    src, config = given / "seam.src", given / "$config.dat"
    by_command = doors.by_command(
        "compensate", place / "model.json", src, "--config", config, "-o", tmp_path / "by_command"
    )
    written = {each.name: each.read_bytes() for each in (tmp_path / "by_command").iterdir()}
    assert by_command.pop("files")
    found = cellctl.load(place / "model.json").compensate_program(src, config=config)
    assert {each.name: each.read_bytes() for each in found.save(tmp_path / "by_python")} == written
    assert {**json.loads(json.dumps(found.report)), "files": ()} == {**by_command, "files": ()}
    folder, _ = analyses.new_analysis(doors.runs, "Ada", "positions.csv")
    shutil.copy(place / "model.json", folder / analyses.MODEL)
    files = [("files", (each.name.lstrip("$"), each.read_bytes())) for each in (src, given / "seam.dat", config)]
    by_api = doors.client.post(f"/api/analyses/{folder.name}/programs", files=files, headers=COMMANDER).json()
    assert {name: by_api[name] for name in ("compensated", "paths")} == {
        name: by_command[name] for name in ("compensated", "paths")
    }
    for name, content in written.items():
        answer = doors.client.get(f"/api/analyses/{folder.name}/programs/{by_api['id']}/{name}")
        assert answer.content == content


@pytest.mark.long
def test_the_check_of_a_procedure(doors: Doors) -> None:
    by_command = doors.by_command("check", "sphere_selfcal", "--cell", "tracker_cell")["mistakes"]
    asked = {"procedure": "sphere_selfcal", "cell": "tracker_cell"}
    by_api = doors.client.post("/api/check", json=asked, headers=COMMANDER).json()["problems"]
    assert [(each["line"], each["what"], each["cure"]) for each in by_api] == [
        (each["line"], each["what"], each["cure"]) for each in by_command
    ]
    assert by_api


@pytest.mark.long
def test_the_events_of_a_run(doors: Doors, tmp_path: Path) -> None:
    command("export", RUNS[0], "--runs", str(doors.runs), "--as", "jsonl", "-o", str(tmp_path / "events.jsonl"))
    by_command = (tmp_path / "events.jsonl").read_text()
    assert doors.client.get(f"/api/runs/{RUNS[0]}/export", params={"form": "jsonl"}).text == by_command
    numbers = [json.loads(line)["seq"] for line in by_command.splitlines()]
    assert [each["seq"] for each in cellctl.open_run(RUNS[0], doors.runs).events()] == numbers


@pytest.mark.long
def test_the_examination_of_a_cell(doors: Doors) -> None:
    """The page of a cell draws the state that the API answers."""
    cell = Cell.load(shipped("cell")["sphere_cell"], DriverRegistry())
    by_command = doors.by_command("doctor", cell.path)
    assert by_command["healthy"]
    asyncio.run(examine_cell(cell.path, doors.runs))
    kept = last_examination(cell, doors.runs)
    assert kept
    assert [each.name for each in kept.devices] == [each["name"] for each in by_command["devices"]]
    assert as_json(replace(kept, at="")).keys() == by_command.keys()
    shown = [(each["serial"], each["state"]) for each in doors.by_api("cells/sphere_cell")["devices"]]
    assert shown == [(each["identity"]["serial"], "in order") for each in by_command["devices"]]


def test_the_library_of_robots(doors: Doors) -> None:
    listed = doors.by_command("robots")["robots"]
    by_api = doors.by_api("robots")
    assert by_api == [{name: robot[name] for name in by_api[0]} for robot in listed]
    found = [cellctl.robot(each["name"]) for each in by_api]
    assert [(robot.name, robot.n) for robot in found] == [(each["robot"], each["joints"]) for each in by_api]


@pytest.mark.long
def test_a_fit(doors: Doors, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, record = analyses.new_analysis(doors.runs, "Ada", "positions.csv")
    for place in (folder, tmp_path):
        shutil.copy(INPUTS / "positions.csv", place / record.data)
        shutil.copy(INPUTS / "robot.yaml", place / "robot.yaml")
    analyses.set_robot(folder, file="robot.yaml")
    analyses.understand_analysis(folder)
    analyses.fit_analysis(folder, analyses.FitSettings(model="zeros"))
    by_api = doors.by_api(f"analyses/{folder.name}/files/fit.json")
    monkeypatch.chdir(tmp_path)
    by_command = doors.by_command("fit", "robot.yaml", "positions.csv", "--model", "zeros")
    by_command.pop("seconds")
    assert by_api == by_command
    assert json.loads(json.dumps(cellctl.fit("robot.yaml", "positions.csv", model="zeros").report)) == by_command
    shown = analyses.state_of(folder)
    assert as_json(shown) == {
        name: value for name, value in doors.by_api(f"analyses/{folder.name}").items() if name in as_json(shown)
    }
