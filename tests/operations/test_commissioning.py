"""Commissioning on the simulated sphere cell: order, confirmations, the record, and what makes a step due again."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from cellctl.devices.cell import Cell
from cellctl.devices.commissioning_record import (
    CellRecord,
    StepRecord,
    commissioning_warnings,
    load_record,
    record_file,
    save_record,
)
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.operations.campaign import load_campaign
from cellctl.operations.commissioning import CommissionedCell, Confirmation, commission
from cellctl.operations.doctor import examine
from drivers import commissioning_motions
from drivers.kuka_rsi.robot import commissioning as kuka_steps
from tests.helpers.runs import SELFCAL, cell_with
from tests.helpers.sliding_robots import sliding_robot_text

STILL = ["robot.connection", "probe.connection", "robot.telegrams", "probe.trip"]
MOVING = ["robot.tenth", "robot.stop", "cell.touch"]
SIMULATE = "simulate:\n  seed: 1\n  clock: lockstep"


class Somebody:
    """Confirms every step but those in `refuses`, and notes what was asked."""

    def __init__(self, *refuses: str) -> None:
        self.refuses = refuses
        self.confirmed_ids: list[str] = []
        self.texts: list[str] = []

    async def confirmed(self, step: StepRecord, number: int, count: int) -> Confirmation | None:
        self.confirmed_ids.append(step.id)
        return None if step.id in self.refuses else Confirmation("Maria", "terminal")

    async def asked(self, text: str) -> None:
        raise AssertionError("at a simulated cell the simulators do what is asked")

    def told(self, text: str) -> None:
        self.texts.append(text)

    def ended(self, step: StepRecord) -> None:
        pass


@pytest.fixture(autouse=True)
def _short_sessions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kuka_steps, "_SESSION_S", 1.5)


def commissioned(cell: Path, person: Somebody | None = None, **options: Any) -> CommissionedCell:
    drivers = DriverRegistry()
    return asyncio.run(commission(Cell.load(cell, drivers), drivers, person or Somebody(), **options))


def states(record: CellRecord) -> dict[str, str]:
    return {step.id: step.state for step in record.steps}


def figures(record: CellRecord, step: str) -> dict[str, Any]:
    found = record.step(step)
    assert found is not None
    return {figure.name: figure.value for figure in found.figures}


def test_without_motion_it_ends_before_the_first_step_that_moves_and_the_record_says_so(tmp_path):
    cell, person = cell_with(tmp_path), Somebody()
    done = commissioned(cell, person, motion=False)
    assert person.confirmed_ids == STILL
    assert states(done.record) == {**dict.fromkeys(STILL, "passed"), **dict.fromkeys(MOVING, "due")}
    kept = load_record(tmp_path / "commissioning.json", "sphere cell", simulated=True)
    assert kept == done.record
    trip = done.record.step("probe.trip")
    assert (trip.confirmed_by, trip.via) == ("Maria", "terminal")
    assert sum("Touch the tip" in text for text in person.texts) == 3


@pytest.mark.long
def test_each_step_measures_what_the_simulated_cell_is(tmp_path):
    done = commissioned(cell_with(tmp_path))
    assert states(done.record) == dict.fromkeys([*STILL, *MOVING], "passed")
    telegrams = figures(done.record, "robot.telegrams")
    assert telegrams["cycle_ms"] == 4
    assert (telegrams["first_delay"], telegrams["delay_rise"], telegrams["lost"]) == (0, 0, 0)
    assert (telegrams["port"], telegrams["mark"]) == ("kept", "session")
    trip = figures(done.record, "probe.trip")
    assert trip["bounces"] == 2
    assert 1.0 < trip["edge_most_ms"] < 4.0, "a line of 2 ms at 250 kbaud, and the adapter's grid of 1 ms"
    assert figures(done.record, "robot.tenth")["a6_deg"] == pytest.approx(0.1, abs=0.002)
    assert figures(done.record, "robot.stop")["lag_ms"] == pytest.approx(24.0, abs=3.0)
    assert 10.0 < figures(done.record, "cell.touch")["way_mm"] < 18.0


@pytest.mark.long
def test_a_simulated_twin_with_the_record_has_the_delays_and_habits_that_were_measured(tmp_path):
    own = "  rsi: {jitter_ms: 0.3, lag_ms: 40, port: new, mark: none}\n  probe: {bounce: 4}\n"
    (tmp_path / "real").mkdir()
    (tmp_path / "twin").mkdir()
    first = commissioned(cell_with(tmp_path / "real", own), Somebody("cell.touch")).record
    assert figures(first, "robot.telegrams")["jitter_ms"] == pytest.approx(0.3, rel=0.15)
    assert figures(first, "robot.stop")["lag_ms"] == pytest.approx(40.0, abs=4.0)
    twin = cell_with(tmp_path / "twin", "  commissioning: ../real/commissioning.json\n")
    second = commissioned(twin, Somebody("cell.touch")).record
    for name in ("port", "mark", "cycle_ms"):
        assert figures(second, "robot.telegrams")[name] == figures(first, "robot.telegrams")[name]
    assert figures(second, "robot.telegrams")["port"] == "new"
    assert figures(second, "robot.telegrams")["jitter_ms"] == pytest.approx(0.3, rel=0.3)
    assert figures(second, "robot.stop")["lag_ms"] == pytest.approx(40.0, abs=6.0)
    assert figures(second, "probe.trip")["bounces"] == 4


@pytest.mark.long
def test_a_step_that_fails_ends_the_call_and_the_next_call_goes_on_there(tmp_path):
    cell = cell_with(tmp_path, "  rsi: {t1: refused}\n")
    done = commissioned(cell, motion=False)
    assert states(done.record)["robot.telegrams"] == "failed"
    assert states(done.record)["probe.trip"] == "due"
    assert "CC_ALLOW_T1" in done.record.step("robot.telegrams").cure
    assert done.error is not None
    cell.write_text(cell.read_text().replace("t1: refused", "t1: allowed"))
    person = Somebody()
    again = commissioned(cell, person, motion=False)
    assert person.confirmed_ids == STILL
    assert set(states(again.record).values()) == {"passed", "due"}
    person = Somebody()
    commissioned(cell, person, motion=False)
    assert person.confirmed_ids == STILL[:2], "each call connects; what is passed is not done again"


@pytest.mark.long
def test_a_limit_that_is_passed_fails_the_step(tmp_path, monkeypatch):
    monkeypatch.setattr(commissioning_motions, "_ASTRAY_DEG", -1.0)
    done = commissioned(cell_with(tmp_path))
    tenth = done.record.step("robot.tenth")
    assert (tenth.state, done.error) == ("failed", None)
    assert [figure.name for figure in tenth.figures if not figure.ok] == ["a1_deg", "others_deg", "back_deg"]
    assert states(done.record)["robot.stop"] == "due"


def test_a_motion_that_nobody_confirms_is_not_begun(tmp_path):
    done = commissioned(cell_with(tmp_path), Somebody("robot.tenth"))
    assert states(done.record)["robot.tenth"] == "declined"
    assert states(done.record)["robot.stop"] == "due"


@pytest.mark.long
def test_a_probe_that_shows_no_contact_fails_with_what_to_look_at(tmp_path):
    cell = cell_with(tmp_path, "  faults:\n    - {fault: probe.no_contact}\n")
    done = commissioned(cell, motion=False)
    trip = done.record.step("probe.trip")
    assert trip.state == "failed"
    assert "within 60 s" in trip.what
    assert "torch lead" in trip.cure


@pytest.mark.long
def test_a_changed_limit_makes_the_steps_of_its_device_due_again_and_another_device_those_it_answers_in(tmp_path):
    cell = cell_with(tmp_path)
    commissioned(cell, motion=False)
    cell.write_text(cell.read_text().replace("travel_deg: 5", "travel_deg: 4.5"))
    person = Somebody()
    commissioned(cell, person, motion=False)
    assert person.confirmed_ids == [*STILL[:2], "robot.telegrams"]
    cell.write_text(cell.read_text().replace("seed: 1", "seed: 2"))  # other serial numbers
    person = Somebody()
    commissioned(cell, person, motion=False)
    assert person.confirmed_ids == STILL


@pytest.mark.long
def test_the_safety_inputs_of_a_plc_are_tried_by_hand(tmp_path):
    cell = cell_with(tmp_path, "", {"devices:\n": "devices:\n  plc: modbus+tcp://192.168.10.5:502?unit=1\n"})
    person = Somebody()
    done = commissioned(cell, person, motion=False)
    assert done.record.step("plc.safety").state == "passed"
    assert done.record.step("robot.telegrams").state == "passed"
    assert any("guard door" in text for text in person.texts)


def real_cell(folder: Path) -> Path:
    return cell_with(folder, "", {SIMULATE: ""})


def warned(cell: Path) -> list[str]:
    drivers = DriverRegistry()
    return [problem.what for problem in commissioning_warnings(Cell.load(cell, drivers), drivers)]


@pytest.mark.long
def test_a_real_cell_without_a_record_is_warned_of_and_a_simulated_record_is_none(tmp_path):
    commissioned(cell_with(tmp_path), motion=False)
    assert warned(tmp_path / "cell.yaml") == []
    cell = real_cell(tmp_path)
    (what,) = warned(cell)
    assert "no record of a commissioning" in what
    assert what in [problem.what for problem in load_campaign(SELFCAL, cell, []).cell.warnings], "check and run show it"


@pytest.mark.long
def test_an_interrupted_motion_is_stopped_and_the_record_says_so(tmp_path):
    cell = cell_with(tmp_path)
    drivers = DriverRegistry()

    class Interrupting(Somebody):
        async def confirmed(self, step: StepRecord, number: int, count: int) -> Confirmation | None:
            if step.moves:
                asyncio.get_running_loop().call_later(1.0, running.cancel)
            return await super().confirmed(step, number, count)

    async def go() -> None:
        nonlocal running
        running = asyncio.create_task(commission(Cell.load(cell, drivers), drivers, Interrupting()))
        await running

    running: asyncio.Task[Any]
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(go())
    kept = load_record(tmp_path / "commissioning.json", "sphere cell", simulated=True)
    assert kept is not None
    interrupted = [step for step in kept.steps if step.what]
    assert [step.what for step in interrupted] == ["was interrupted"]
    assert interrupted[0].moves
    assert interrupted[0].state == "failed"


def test_a_real_cell_is_warned_of_when_its_record_is_incomplete_or_out_of_date(tmp_path):
    simulated = commissioned(cell_with(tmp_path), motion=False).record
    cell = real_cell(tmp_path)
    still = tuple(step for step in simulated.steps if not step.moves)
    save_record(record_file(cell), CellRecord("sphere cell", simulated=False, steps=still))
    assert warned(cell) == []
    save_record(record_file(cell), CellRecord("sphere cell", simulated=False, steps=simulated.steps))
    (what,) = warned(cell)
    assert "is not complete: robot.tenth" in what
    cell.write_text(cell.read_text().replace("correction_deg: 5", "correction_deg: 4.5"))
    (what,) = warned(cell)
    assert "due again are robot.connection, robot.telegrams" in what
    assert "probe" not in what


def test_a_damaged_record_is_refused_before_anything_connects(tmp_path):
    cell = cell_with(tmp_path)
    file = tmp_path / "commissioning.json"
    for text, words in (("{", "Expecting"), ('{"format": "other"}', "'other'"), ("[]", "'None'")):
        file.write_text(text)
        with pytest.raises(InputError, match="is no record of a commissioning") as caught:
            commissioned(cell, motion=False)
        assert words in str(caught.value)
    file.write_text(json.dumps({"format": "cellctl commissioning 1", "cells": [{"cell": 3}]}))
    with pytest.raises(InputError, match=r"cells\.0\.cell"):
        commissioned(cell, motion=False)


def test_records_of_other_cells_in_the_folder_stay(tmp_path):
    file = tmp_path / "commissioning.json"
    for name in ("one", "other", "one"):
        save_record(file, CellRecord(name, simulated=False))
    assert [one["cell"] for one in json.loads(file.read_text())["cells"]] == ["other", "one"]


@pytest.mark.long
def test_a_robot_on_a_rail_is_refused_by_name_where_it_would_move_and_its_devices_are_examined(tmp_path):
    cell = tmp_path / "cell.yaml"
    (tmp_path / "rail.yaml").write_text(sliding_robot_text("rail"))
    cell.write_text("name: rail\nmodel: rail.yaml\ndevices: {robot: 'ur+rtde://127.0.0.1:1?dashboard=1'}\n")
    refusal = "joint 1 of KR 5 on a rail is prismatic: a {} is for revolute joints only"
    with pytest.raises(InputError, match=refusal.format("commissioning")):
        commissioned(cell)
    with pytest.raises(InputError, match=refusal.format("campaign")):
        load_campaign(SELFCAL, cell, [])
    drivers = DriverRegistry()
    (robot,) = asyncio.run(examine(Cell.load(cell, drivers), drivers))
    assert "prismatic" not in robot.what
    assert "127.0.0.1" in robot.address
