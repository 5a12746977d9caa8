"""A fleet: which robots need a calibration and why, by what the index of the runs holds."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellctl.cli.verbs import app
from cellctl.operations.fleet import Fleet, FleetReading, FleetRobot, fleet
from cellctl.operations.table_history import TableHistory
from cellctl.run_index import IndexedParameter, IndexedRun, RunIndex, opened_index
from tests.helpers.arms import kr5_model

SIGMAS = {"theta3": 4e-5, "a2": 0.03, "alpha2": 6e-5, "tool_x": 0.1}
UNITS = {"theta3": "rad", "a2": "mm", "alpha2": "rad", "tool_x": "mm"}
FIRST = datetime(2026, 1, 1, 6)
NOW = "2027-01-10T00:00:00Z"


@pytest.fixture
def index(tmp_path: Path) -> Iterator[RunIndex]:
    with opened_index(tmp_path) as found:
        yield found


def calibration(serial: str, month: int, values: dict[str, float], **more: Any) -> IndexedRun:
    """A run with a model, some months after the first."""
    began = (FIRST + timedelta(days=30 * month)).strftime("%Y-%m-%dT%H:%M:%SZ")
    stated = {
        "robot_type": "KR5",
        "site": "hall 1",
        "simulated": True,
        "nominal": "kr5",
        "identity": f"{serial} {month}",
    }
    parameters = tuple(
        IndexedParameter(name, UNITS[name], value, SIGMAS[name], 1e3 * SIGMAS[name]) for name, value in values.items()
    )
    return IndexedRun(
        run=f"{serial}-{month:02d}",
        fingerprint="made",
        settled=True,
        began=began,
        state="finished",
        serial=serial,
        has_model=True,
        content="{}",
        parameters=parameters,
        **{**stated, **more},  # type: ignore[arg-type]
    )


def robot(serial: str, *, moved: dict[str, float] | None = None, noise: float = 1.0, **more: Any) -> list[IndexedRun]:
    """Twelve months of a robot; `moved`: what its parameters change by in the seventh."""
    rng = np.random.default_rng([ord(letter) for letter in serial])
    own = {name: rng.normal() for name in SIGMAS}
    return [
        calibration(
            serial,
            month,
            {
                name: own[name] + noise * sigma * rng.normal() + (moved or {}).get(name, 0.0) * (month >= 6)
                for name, sigma in SIGMAS.items()
            },
            **more,
        )
        for month in range(12)
    ]


def told(index: RunIndex, folder: Path, *robots: list[IndexedRun]) -> Fleet:
    for each in robots:
        index.put(each)
    return fleet(index, folder, now=NOW)


def of(found: Fleet, serial: str) -> FleetRobot:
    return next(each for each in found.robots if each.serial == serial)


def test_a_robot_whose_joint_zero_moved_is_first_with_what_moved_how_far_and_since_when(
    index: RunIndex, tmp_path: Path
) -> None:
    found = told(index, tmp_path, *(robot(f"R{n}") for n in range(6)), robot("worn", moved={"theta3": 20 * 4e-5}))
    first = found.robots[0]
    assert (first.serial, first.state, [each.name for each in first.moved]) == ("worn", "calibrate", ["theta3"])
    (moved,) = first.moved
    assert moved.unit == "°"
    assert abs(moved.change - np.rad2deg(20 * 4e-5)) < 4.0 * moved.sigma
    assert moved.since[:10] in ("2026-06-30", "2026-07-30")  # the first run with it, or the one after
    assert [each.serial for each in found.to_calibrate] == ["worn"]
    assert {each.state for each in found.robots[1:]} == {"in limits"}
    assert first.charts == 3  # not the tool, which changes with the set-up


def test_the_motion_at_the_tool_is_that_of_the_model(index: RunIndex, tmp_path: Path) -> None:
    worn = robot("worn", moved={"a2": 1.0})
    (tmp_path / worn[0].run).mkdir()
    kr5_model().save(tmp_path / worn[0].run / "model.json")
    (moved,) = told(index, tmp_path, worn).robots[0].moved
    assert moved.label == "a2"
    assert moved.mm == pytest.approx(abs(moved.change), rel=1e-3)  # a length moves the TCP by as much, at all joints


def test_a_table_put_in_force_is_the_new_reference(index: RunIndex, tmp_path: Path) -> None:
    runs = robot("worn", moved={"theta3": 20 * 4e-5})
    runs[8] = calibration("worn", 8, {p.name: p.value for p in runs[8].parameters}, table_state="proved")
    found = of(told(index, tmp_path, runs), "worn")
    assert (found.calibration, found.runs, found.state) == ("worn-08", 4, "in limits")


def test_the_run_of_the_table_in_force_by_its_history_is_the_reference(index: RunIndex, tmp_path: Path) -> None:
    history = TableHistory(tmp_path, "worn")
    history.folder.mkdir(parents=True)
    begin = {"kind": "begin", "change": "c", "time": NOW, "serial": "worn", "action": "push", "who": "Kim@pc"}
    begin |= {"run": None, "table": "a" * 64, "replaced": None, "reason": ""}
    facts = {"rows": 9, "max_correction_deg": 0.1, "model_sha256": "b" * 64, "method": "m", "run": "worn-09"}
    end = {"kind": "end", "change": "c", "time": NOW, "result": "in force", "reason": ""}
    history.file.write_text(json.dumps({**begin, "facts": facts}) + "\n" + json.dumps(end) + "\n")
    found = told(index, tmp_path, robot("worn", moved={"theta3": 20 * 4e-5}))
    assert found.robots[0].calibration == "worn-09"


def test_runs_of_another_nominal_robot_copies_and_models_taken_over_are_left_out(
    index: RunIndex, tmp_path: Path
) -> None:
    runs = robot("R1")
    values = {parameter.name: parameter.value for parameter in runs[5].parameters}
    more = [
        calibration("R1", 20, {"theta3": 1.0}, nominal="other"),
        calibration("R1", 21, values, identity="verified"),
        calibration("R1", 22, {"theta3": 0.5}, identity=runs[3].identity),
    ]
    found = told(index, tmp_path, runs, more[:2])
    assert (found.left_out, of(found, "R1").runs) == (2, 12)
    index.put(more[2:])
    assert of(fleet(index, tmp_path, now=NOW), "R1").runs == 12


def test_what_most_robots_of_a_site_show_together_is_said_of_the_site_and_of_them(
    index: RunIndex, tmp_path: Path
) -> None:
    warm = [robot(f"W{n}", moved={"a2": 15 * 0.03}, site="hall 2") for n in range(5)]
    found = told(index, tmp_path, *warm, *(robot(f"R{n}") for n in range(6)), robot("worn", moved={"theta3": 1e-3}))
    sites = {group.name: [each.name for each in group.moved] for group in found.groups if group.kind == "site"}
    assert sites == {"hall 1": [], "hall 2": ["a2"]}
    assert of(found, "W1").together == ("a2",)
    assert "instrument and temperature" in of(found, "W1").words
    assert of(found, "worn").together == ()
    assert {group.name: group.to_calibrate for group in found.groups if group.kind == "site"} == {
        "hall 1": 1,
        "hall 2": 5,
    }
    chosen = FleetReading(index, tmp_path).fleet(site="hall 1", now=NOW)
    assert {each.site for each in chosen.robots} == {"hall 1"}
    assert len(chosen.robots) == 7


def test_a_stated_sigma_that_is_too_small_is_noticed_and_calls_no_robot(index: RunIndex, tmp_path: Path) -> None:
    found = told(index, tmp_path, *(robot(f"R{n}", noise=4.0) for n in range(12)))
    assert {each.name: each.serial for each in found.small_sigmas} == {"theta3": "", "a2": "", "alpha2": ""}
    assert all(3.0 < each.scale < 5.0 and each.differences == 132 for each in found.small_sigmas)
    assert found.to_calibrate == []


def test_age_counts_for_a_real_robot_and_by_the_days_of_its_cell_file(index: RunIndex, tmp_path: Path) -> None:
    found = told(
        index,
        tmp_path,
        robot("simulated"),
        robot("real", simulated=False),
        robot("stated", simulated=False, due_days=400.0),
    )
    assert {each.serial: each.state for each in found.robots} == {
        "real": "calibrate",
        "simulated": "in limits",
        "stated": "in limits",
    }
    assert of(found, "real").words == "calibrated 374 days ago, due after 180"


def test_a_failed_check_counts_until_the_robot_is_calibrated(index: RunIndex, tmp_path: Path) -> None:
    common: dict[str, Any] = {"state": "finished", "began": NOW, "simulated": True, "content": "{}"}
    failed = IndexedRun(run="check", fingerprint="c", verdict="recalibrate", serial="R1", **common)
    rejected = IndexedRun(run="accept", fingerprint="a", acceptance="rejected", serial="R2", **common)
    found = told(index, tmp_path, robot("R1"), robot("R2"), robot("R3"), [failed, rejected])
    assert {each.serial: each.words for each in found.to_calibrate} == {
        "R1": "check says recalibrate",
        "R2": "accept is rejected",
    }
    index.put([calibration("R1", 20, {"theta3": 0.0}, table_state="proved")])
    assert [each.serial for each in fleet(index, tmp_path, now=NOW).to_calibrate] == ["R2"]


def test_a_robot_without_a_model_is_listed_as_not_calibrated_and_has_no_charts(index: RunIndex, tmp_path: Path) -> None:
    check = IndexedRun(run="c", fingerprint="c", state="finished", serial="R1", began=NOW, simulated=True, content="{}")
    assert [each.state for each in told(index, tmp_path, [check], robot("R2")[:1]).robots] == [
        "not calibrated",
        "not judged",
    ]
    with pytest.raises(LookupError):
        FleetReading(index, tmp_path).charts("R1")


def test_the_charts_of_a_robot_have_all_its_runs_in_shown_units_the_worst_first(
    index: RunIndex, tmp_path: Path
) -> None:
    index.put(robot("worn", moved={"theta3": 20 * 4e-5}))
    found = FleetReading(index, tmp_path).charts("worn")
    assert len(found.runs) == 12
    first = found.parameters[0]
    assert (first.name, first.unit, first.means[0]) == ("theta3", "°", None)
    before = np.array(first.values[:5], float)
    assert before.mean() == pytest.approx(0.0, abs=1e-12)  # less the reference, which is their mean
    mean, limit = first.means[-1], first.limits[-1]
    assert mean is not None
    assert limit is not None
    assert mean > limit > 0.0
    assert first.found == pytest.approx(0.0057, rel=0.1)  # (2.8 + 1.3) σ of the mean, 0.56 of a run's, over 1 − 0.8¹⁰


def test_the_command_lists_what_to_calibrate_and_writes_json(
    index: RunIndex, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    index.put([*robot("worn", moved={"theta3": 20 * 4e-5}), *robot("R1")])
    monkeypatch.setattr("cellctl.operations.run_indexing.update", lambda *_, **__: None)  # the runs are made rows
    app(["fleet", "--runs", str(tmp_path)], standalone_mode=False)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "1 of 2 robots need a calibration"
    assert lines[1] == "worn (KR5, hall 1, SIMULATED): calibrate"
    assert lines[2].startswith("    theta3 +0.046")
    app(["fleet", "--runs", str(tmp_path), "--site", "none", "--json", "-"], standalone_mode=False)
    assert json.loads(capsys.readouterr().out) == {"robots": [], "groups": [], "small_sigmas": [], "left_out": 0}
