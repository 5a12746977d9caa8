"""The measured contact is where contact was, and a search comes out the same on any machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.engine import State
from tests.helpers.runs import CELL, UNHURRIED, Ended, busy_machine, cell_with, run_here, touches_procedure, unhurried
from tests.helpers.simulated_data import true_points

pytestmark = pytest.mark.campaign

REPEATABILITY_MM = 0.03
ALLOWANCE_MM = 0.01
TWO_TOUCHES = """
procedure: two_touches
title: Two touches, nothing identified
steps:
  - {id: plan, do: sphere.plan, with: {fit: 5, held_out: 1}, timeout: 120}
  - {id: first, do: sphere.touch, with: {touch: "${plan.touches[0]}", speed_mm_s: 5}, timeout: 120}
  - {id: second, do: sphere.touch, with: {touch: "${plan.touches[1]}", speed_mm_s: 5}, timeout: 120}
"""


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Ended:
    """Some touches of the shipped cell, in lockstep."""
    folder = tmp_path_factory.mktemp("idle")
    return run_here(touches_procedure(folder), cell_with(folder), folder)


def off_truth(ended: Ended, cell: Path, folder: Path) -> np.ndarray:
    """Distances (N,), mm, from the true mean tip at the measured joints to where the tip was at contact."""
    joints = np.array([row["joints"] for row in ended.touches])
    measured = true_points(cell, 1, joints, folder)
    contacts = np.array([contact["tcp"] for contact in ended.truth])
    return np.linalg.norm(measured - contacts, axis=1)


@pytest.mark.long
def test_without_scatter_the_measured_contact_is_the_true_one_to_a_hundredth(tmp_path: Path) -> None:
    cell = cell_with(tmp_path, "  errors: {repeatability: 0}\n")
    ended = run_here(touches_procedure(tmp_path), cell, tmp_path)
    assert ended.outcome.state is State.FINISHED
    assert off_truth(ended, cell, tmp_path).max() <= ALLOWANCE_MM


@pytest.mark.long
@pytest.mark.parametrize(("mode", "cycle"), [("absolute", "ipo"), ("relative", "ipo_fast"), ("relative", "ipo")])
def test_the_measured_contact_is_the_true_one_in_the_other_modes_and_cycles_of_rsi_on(
    tmp_path: Path, mode: str, cycle: str
) -> None:
    ethernet = (CELL.parent / "rsi_ethernet.xml").read_text()
    (tmp_path / "rsi.xml").write_text(ethernet.replace('HOLDON="1"', 'HOLDON="0"') if mode == "relative" else ethernet)
    address = {f"{CELL.parent}/rsi_ethernet.xml": f"rsi.xml&mode={mode}&cycle={cycle}"}
    cell = cell_with(tmp_path, "  errors: {repeatability: 0}\n", address)
    procedure = tmp_path / "two_touches.yaml"
    procedure.write_text(TWO_TOUCHES)
    ended = run_here(procedure, cell, tmp_path)
    assert ended.outcome.state is State.FINISHED
    assert len(ended.touches) == 2
    assert off_truth(ended, cell, tmp_path).max() <= ALLOWANCE_MM
    assert ended.robot_is_held()


@pytest.mark.long
def test_the_measured_contact_is_the_true_one_within_repeatability(idle: Ended, tmp_path: Path) -> None:
    rms = float(np.sqrt(np.mean(off_truth(idle, CELL, tmp_path) ** 2)))
    assert 0.2 * REPEATABILITY_MM < rms <= REPEATABILITY_MM + ALLOWANCE_MM


@pytest.mark.long
def test_the_stopped_pose_would_be_a_worse_measurement_than_the_contact(idle: Ended) -> None:
    overtravel = [contact["overtravel_mm"] for contact in idle.truth]
    assert min(overtravel) > 3 * ALLOWANCE_MM
    assert max(overtravel) < 0.4
    assert all(row["stop_cycles"] <= 2 for row in idle.touches)


@pytest.mark.long
def test_over_travel_in_lockstep_is_the_same_on_an_idle_and_on_a_busy_machine(idle: Ended, tmp_path: Path) -> None:
    with busy_machine():
        busy = run_here(touches_procedure(tmp_path), cell_with(tmp_path), tmp_path)
    over = [[contact["overtravel_mm"] for contact in ended.truth] for ended in (idle, busy)]
    assert over[0] == pytest.approx(over[1], abs=1e-6)
    late = [[row[count] for row in ended.touches for count in ("late", "lost", "skipped")] for ended in (idle, busy)]
    assert late[0] == late[1] == [0] * 18


@pytest.mark.long
@pytest.mark.realtime
def test_the_same_campaign_runs_in_real_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    unhurried(monkeypatch)
    cell = cell_with(tmp_path, UNHURRIED)
    ended = run_here(touches_procedure(tmp_path), cell, tmp_path, clock="realtime")
    assert ended.outcome.state is State.FINISHED
    assert len(ended.touches) == 6
    rms = float(np.sqrt(np.mean(off_truth(ended, cell, tmp_path) ** 2)))
    assert rms <= REPEATABILITY_MM + 2 * ALLOWANCE_MM
