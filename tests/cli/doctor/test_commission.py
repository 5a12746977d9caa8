"""`cellctl doctor --commission`: confirmations at the terminal, exit codes, the page; in real time."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import shutil
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from cellctl.cli import commissioning
from cellctl.cli.commissioning import _AtTerminal
from cellctl.devices import Figure
from cellctl.devices.commissioning_record import CellRecord, StepRecord
from cellctl.operations.commissioning import Confirmation
from cellctl.report import commissioning_page
from tests.helpers.runs import CELL, cell_with, cellctl

MOVES = StepRecord("robot.tenth", "robot", "a tenth of a degree", "A1 moves.", "wiring", moves=True)
STILL = StepRecord("probe.trip", "probe", "trips by hand", "Touch it.", "contacts", moves=False)


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The other end of the terminal that standard input is."""
    keys, terminal = pty.openpty()
    with open(terminal, closefd=True) as stdin:  # noqa: PTH123 - a descriptor, not a path
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(commissioning, "interactive", lambda: True)
        yield keys
    os.close(keys)


def confirmed(step: StepRecord, *lines: bytes, keyboard: int = -1, yes: bool = False, simulated: bool = False) -> Any:
    attendant = _AtTerminal("operator", yes=yes, simulated=simulated, to_stderr=True)

    async def ask() -> Confirmation | None:
        asking = asyncio.create_task(attendant.confirmed(step, 1, 1))
        for line in lines:
            await asyncio.sleep(0.05)
            os.write(keyboard, line)
        async with asyncio.timeout(60):
            return await asking

    return asyncio.run(ask())


def test_a_motion_begins_with_the_name_of_who_confirms_it_and_with_nothing_else(keyboard):
    by_name = confirmed(MOVES, b"yes\n", b"y\n", b"Maria Huber\n", keyboard=keyboard)
    assert by_name == Confirmation("Maria Huber", "terminal")
    assert confirmed(MOVES, b"\n", keyboard=keyboard) is None
    assert confirmed(MOVES, b"no\n", keyboard=keyboard) is None


def test_a_step_without_motion_begins_with_enter(keyboard):
    assert confirmed(STILL, b"\n", keyboard=keyboard) == Confirmation("operator", "terminal")
    assert confirmed(STILL, b"q\n", keyboard=keyboard) is None


def test_yes_does_not_confirm_the_motion_of_a_real_robot(keyboard, monkeypatch):
    assert confirmed(MOVES, b"Maria\n", keyboard=keyboard, yes=True) == Confirmation("Maria", "terminal")
    monkeypatch.setattr(commissioning, "interactive", lambda: False)
    assert confirmed(MOVES, yes=True) is None
    assert confirmed(STILL, yes=True) == Confirmation("operator", "--yes")
    assert confirmed(MOVES, yes=True, simulated=True) == Confirmation("operator", "--yes")


@pytest.mark.long
def test_without_a_terminal_and_without_yes_nothing_is_opened(tmp_path):
    done = cellctl("doctor", cell_with(tmp_path), "--commission")
    assert done.returncode == 2
    assert "standard input is no terminal" in done.stderr
    assert not (tmp_path / "commissioning.json").exists()


@pytest.mark.long
def test_options_of_a_commissioning_are_refused_without_it(tmp_path):
    assert cellctl("doctor", CELL, "--yes").returncode == 2


@pytest.mark.long
def test_a_page_of_a_cell_without_a_record_is_refused(tmp_path):
    done = cellctl("doctor", cell_with(tmp_path), "--page", tmp_path / "page.html")
    assert done.returncode == 2
    assert "has no record of a commissioning" in done.stderr


def test_the_page_shows_figures_limits_and_names_and_escapes_texts():
    figures = (Figure("stop_ms", "time", 200.25, "ms", most=150.0), Figure("port", "port", "<new>"))
    step = StepRecord("robot.stop", "robot", "stop", "A1 moves.", "it", True, "failed", figures, confirmed_by="Maria")
    page = commissioning_page(CellRecord("cell 3", simulated=False, steps=(step,)))
    assert '<td class="outside">200.2 ms</td><td>at most 150</td>' in page
    assert "&lt;new&gt;" in page
    assert "Maria" in page
    assert "SIMULATED" not in page
    assert "SIMULATED" in commissioning_page(CellRecord("cell 3", simulated=True))


@pytest.mark.long
def test_a_step_whose_device_fails_ends_with_its_code_and_the_record_has_the_reason(tmp_path):
    cell = cell_with(tmp_path, "  rsi: {t1: refused}\n")
    done = cellctl("doctor", cell, "--commission", "--yes", "--no-motion", "--json", tmp_path / "done.json")
    assert done.returncode == 3
    assert "CC_ALLOW_T1=TRUE" in done.stderr
    (failed,) = (step for step in json.loads((tmp_path / "done.json").read_text())["steps"] if step["what"])
    assert (failed["id"], failed["state"]) == ("robot.telegrams", "failed")


@pytest.mark.long
@pytest.mark.realtime
def test_the_sphere_cell_is_commissioned_in_real_time(tmp_path):
    """Limits may be missed on a loaded machine: then the exit code, the record and the end of the sequence say so."""
    cell, page = cell_with(tmp_path), tmp_path / "page.html"
    clock = ("--clock", "realtime", "--json", tmp_path / "done.json", "--page", page, "--operator", "Maria")
    done = cellctl("doctor", cell, "--commission", "--yes", *clock)
    steps = {step["id"]: step for step in json.loads((tmp_path / "done.json").read_text())["steps"]}
    telegrams = {figure["name"]: figure["value"] for figure in steps["robot.telegrams"]["figures"]}
    assert telegrams["telegrams"] > 14_000, "a minute, at 4 ms"
    assert telegrams["jitter_most_ms"] > 0.0
    assert (telegrams["port"], telegrams["mark"]) == ("kept", "session")
    begun = [step for step in steps.values() if step["state"] != "due"]
    assert all(step["state"] == "passed" for step in begun[:-1])
    assert (done.returncode == 0) is (begun[-1]["id"] == "cell.touch" and begun[-1]["state"] == "passed"), done.stderr
    assert all(step["confirmed_by"] == "Maria" for step in begun)
    assert page.read_text().count("<h2>") == 7


@pytest.mark.long
def test_a_cell_of_a_ur_is_commissioned_with_the_same_call(tmp_path):
    done = cellctl("doctor", ur_cell(tmp_path), "--commission", "--yes", "--json", tmp_path / "done.json")
    assert done.returncode == 0, done.stderr
    steps = {step["id"]: step for step in json.loads((tmp_path / "done.json").read_text())["steps"]}
    assert all(step["state"] == "passed" for step in steps.values())
    assert "T1" not in done.stdout
    data = {figure["name"]: figure["value"] for figure in steps["robot.data"]["figures"]}
    assert (data["packages"], data["skipped"], data["stale"]) == (pytest.approx(15_000, abs=20), 0, 0)
    assert 0.0 < data["current_a"] < 0.1
    (contacts,) = steps["robot.wire"]["figures"]
    assert contacts["value"] == 3
    assert {"a1_deg", "a6_deg"} <= {figure["name"] for figure in steps["robot.tenth"]["figures"]}
    stop = {figure["name"]: figure["value"] for figure in steps["robot.stop"]["figures"]}
    assert 0.0 < stop["stop_ms"] < 150.0


def ur_cell(folder):
    """A copy of the shipped cell of a UR10e, with its programs."""
    shutil.copytree(CELL.parent / "ur10e_programs", folder / "ur10e_programs")
    text = (CELL.parent / "ur10e_cell.yaml").read_text().replace("../robots/", f"{CELL.parents[1]}/robots/")
    path = folder / "cell.yaml"
    path.write_text(text)
    return path
