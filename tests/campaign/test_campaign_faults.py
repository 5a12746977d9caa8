"""Faults in a campaign: each has a clear end, the robot is held, no recorded row is lost."""

from __future__ import annotations

import asyncio
import socket
from pathlib import Path
from typing import Any

import pytest

from cellctl.cli import exit_codes
from cellctl.devices import DeviceFault, DeviceLost, NoContact, ProbeNotOpen
from cellctl.engine import Mailbox, State
from cellctl.journal import Outcome
from cellctl.operations.campaign import load_campaign
from cellctl.operations.cell_devices import SimulatedCell
from tests.helpers.runs import CELL, Ended, cell_with, cellctl, faults, run_here, touches_procedure

pytestmark = pytest.mark.campaign

FIVE_MISTAKES = """procedure: selfcal
title: Five errors
cell: {cell}
parameters:
  touches_fit: {{type: integer, default: 5, min: 10, max: 200}}
steps:
  - id: plan
    do: sphere.plann
    with: {{fit: 10, held_out: 5}}
  - id: points
    for_each: ${{plan.touches}}
    as: planned
    steps:
      - id: touch
        do: sphere.touch
        with: {{touch: "${{planed}}", speed_mm_s: -5}}
        timout: 90
"""


def test_a_procedure_with_five_errors_names_all_five_and_opens_no_socket(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    procedure = tmp_path / "five.yaml"
    procedure.write_text(FIVE_MISTAKES.format(cell=cell_with(tmp_path)))

    def no_socket(*_: Any, **__: Any) -> None:
        raise AssertionError("a socket was opened")

    monkeypatch.setattr(socket, "socket", no_socket)
    assert exit_codes.exit_code_of(lambda: load_campaign(procedure, None, [])) == 2
    said = capsys.readouterr().err
    for place, word in (
        ("five.yaml:5:", "default"),
        ("five.yaml:8:9:", "sphere.plan"),
        ("five.yaml:16:", "planed"),
        ("five.yaml:16:", "speed_mm_s"),
        ("five.yaml:17:9:", "timeout"),
    ):
        assert any(place in line and word in "".join(rest) for line, *rest in _blocks(said)), (place, word, said)


def test_a_refused_procedure_ends_with_exit_code_2_and_leaves_no_run(tmp_path: Path) -> None:
    procedure = tmp_path / "five.yaml"
    procedure.write_text(FIVE_MISTAKES.format(cell=cell_with(tmp_path)))
    done = cellctl("run", procedure, "--runs", tmp_path / "runs")
    assert done.returncode == 2
    assert "5 errors, nothing was moved" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.long
def test_a_taken_rsi_port_is_named_before_anything_moves(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("127.0.0.1", 0))
        port = holder.getsockname()[1]
        ethernet = tmp_path / "rsi_ethernet.xml"
        ethernet.write_text((CELL.parent / "rsi_ethernet.xml").read_text().replace("49152", str(port)))
        real = {
            f"192.168.10.2:49152?ethernet={CELL.parent}": f"127.0.0.1:{port}?ethernet={tmp_path}",
            "simulate:\n  seed: 1\n  clock: lockstep": "",
        }
        cell = cell_with(tmp_path, replace=real)
        done = cellctl("run", touches_procedure(tmp_path), "--cell", cell, "--runs", tmp_path / "runs")
    assert done.returncode == 3
    assert f"UDP port {port} on 127.0.0.1 is taken" in done.stderr
    assert "probe:" in done.stderr, "the missing probe is named in the same error"


@pytest.mark.long
def test_no_telegram_says_what_to_look_at(tmp_path: Path) -> None:
    ended = _touches_with("fault: rsi.silent, search: 3", tmp_path)
    assert isinstance(ended.outcome.error, DeviceLost)
    assert "no telegram" in str(ended.outcome.error)
    assert "firewall" in str(ended.outcome.error)
    _cleanly_failed(ended, touches=2)


@pytest.mark.long
def test_a_wrong_sentype_is_named(tmp_path: Path) -> None:
    ended = _touches_with("fault: rsi.sentype, search: 1", tmp_path)
    assert isinstance(ended.outcome.error, DeviceFault)
    assert "SENTYPE" in str(ended.outcome.error)
    _cleanly_failed(ended, touches=0)


@pytest.mark.long
def test_a_probe_that_is_closed_at_arming_starts_no_search(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.closed, search: 2, after_ms: 5500", tmp_path)
    assert isinstance(ended.outcome.error, ProbeNotOpen)
    _cleanly_failed(ended, touches=2)
    assert len(ended.truth) == 2


@pytest.mark.long
def test_a_wire_break_in_a_search_stops_the_robot(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.wire_break, search: 3, after_ms: 400", tmp_path)
    assert isinstance(ended.outcome.error, DeviceFault)
    assert "wire" in str(ended.outcome.error).lower()
    _cleanly_failed(ended, touches=2)
    assert len(ended.truth) == 2, "the tip must not have reached the sphere"


@pytest.mark.long
def test_a_probe_silent_for_200_ms_in_a_search_stops_the_robot(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.silent, search: 3, after_ms: 300", tmp_path)
    assert isinstance(ended.outcome.error, DeviceLost)
    assert "probe" in str(ended.outcome.error)
    _cleanly_failed(ended, touches=2, probe_gone=True)
    assert len(ended.truth) == 2, "the tip must not have reached the sphere"


@pytest.mark.long
def test_no_contact_within_travel_is_tried_again_and_then_ends_the_run(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.no_contact, search: 3", tmp_path)
    assert isinstance(ended.outcome.error, NoContact)
    _cleanly_failed(ended, touches=2)
    attempts = [step for step in ended.journal.steps.values() if step.step == "points[2].touch"]
    assert attempts[0].attempt == 2


@pytest.mark.long
def test_a_search_without_contact_once_is_made_good_by_the_retry(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.no_contact, search: 3, for_ms: 6500", tmp_path)
    assert ended.outcome.state is State.FINISHED
    assert [row["attempt"] for row in ended.touches] == [1, 1, 2, 1, 1, 1]


@pytest.mark.long
def test_a_closure_in_mid_air_is_no_contact_and_the_retry_makes_it_good(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.closed, search: 3, after_ms: 1200, for_ms: 30", tmp_path)
    assert ended.outcome.state is State.FINISHED
    assert [row["attempt"] for row in ended.touches] == [1, 1, 2, 1, 1, 1]
    assert len(ended.truth) == 6, "what was recorded are contacts with spheres"


@pytest.mark.long
def test_a_loop_that_closes_early_and_stays_closed_is_no_contact(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.closed, search: 3, after_ms: 300", tmp_path)
    assert isinstance(ended.outcome.error, ProbeNotOpen)
    _cleanly_failed(ended, touches=2)


@pytest.mark.long
def test_a_loop_that_closes_anywhere_and_stays_closed_does_not_count(tmp_path: Path) -> None:
    ended = _touches_with("fault: probe.closed, search: 3, after_ms: 1500", tmp_path)
    assert isinstance(ended.outcome.error, ProbeNotOpen)
    assert "still closed" in str(ended.outcome.error)
    _cleanly_failed(ended, touches=2)


@pytest.mark.long
def test_a_robot_stopped_on_the_retreat_leaves_the_contact_in_the_journal_though_it_does_not_count(
    tmp_path: Path,
) -> None:
    ended = _touches_with("fault: robot.stop, search: 3, after_ms: 3000", tmp_path)
    assert "EMERGENCY STOP" in str(ended.outcome.error)
    assert len(ended.truth) == 3
    assert len([row for row in ended.journal.rows if row.event.row_kind == "touch"]) == 3
    assert len(ended.touches) == 2, "a resumed run does the third one again, and counts it once"


@pytest.mark.long
def test_an_rsi_stall_past_the_late_count_is_the_controllers_stop_and_is_named(tmp_path: Path) -> None:
    ended = _touches_with("fault: rsi.stall, search: 3, after_ms: 300, for_ms: 1000", tmp_path)
    assert isinstance(ended.outcome.error, DeviceFault)
    assert "KSS29002" in str(ended.outcome.error)
    _cleanly_failed(ended, touches=2)


@pytest.mark.long
def test_a_short_rsi_stall_is_survived_and_counted(tmp_path: Path) -> None:
    ended = _touches_with("fault: rsi.stall, search: 3, after_ms: 300, for_ms: 60", tmp_path)
    assert ended.outcome.state is State.FINISHED
    assert [row["late"] > 0 for row in ended.touches] == [False, False, True, False, False, False]


@pytest.mark.long
def test_the_operators_stop_in_a_search_ends_the_run(tmp_path: Path) -> None:
    ended = _touches_with("fault: robot.stop, search: 3, after_ms: 300", tmp_path)
    assert isinstance(ended.outcome.error, DeviceFault)
    _cleanly_failed(ended, touches=2)


@pytest.mark.long
def test_abort_in_a_search_leaves_the_robot_held_and_everything_recorded(tmp_path: Path) -> None:
    async def abort_in_the_third_search(mailbox: Mailbox, simulated: SimulatedCell) -> None:
        while (await simulated.tell({"op": "status"}))["searches"] < 3:
            await asyncio.sleep(0.01)  # of some seconds of a search: the cell's time waits for this loop
        mailbox.abort()
        mailbox.abort()

    ended = run_here(touches_procedure(tmp_path), cell_with(tmp_path), tmp_path, meanwhile=abort_in_the_third_search)
    assert len(ended.truth) == 2, "the tip has not reached the sphere"
    assert ended.outcome.state is State.ABORTED
    assert ended.robot_is_held()
    assert ended.journal.state == "aborted"
    assert len(ended.touches) == 2


def _touches_with(fault: str, folder: Path) -> Ended:
    """Six touches in the shipped cell with this fault."""
    return run_here(touches_procedure(folder), cell_with(folder, faults(fault)), folder)


def _cleanly_failed(ended: Ended, touches: int, *, probe_gone: bool = False) -> None:
    assert ended.robot_is_held()
    assert len(ended.touches) == touches
    assert ended.journal.ended is not None
    assert not ended.journal.in_flight
    assert ended.journal.steps["cleanup.hold"].outcome is Outcome.DONE
    assert ended.outcome.state is State.FAILED, ended.outcome.troubles


def _blocks(text: str) -> list[list[str]]:
    blocks: list[list[str]] = []
    for line in text.splitlines():
        if line.startswith(" ") and blocks:
            blocks[-1].append(line)
        else:
            blocks.append([line, line])
    return blocks
