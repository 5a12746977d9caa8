"""On-line correction over the wires: held-out targets before and after, and faults in mid-correction."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from cell_runs import ROOT, cellctl, only_run
from corrected_cells import HEAVY_CELL, simulated_robot
from online_models import wavy_model
from verified_targets import MOST_MM, TARGETS, calibrated

from cellctl.devices import CorrectionModel, DeviceError, DeviceLost, DeviceRefused
from cellctl.journal import fold, read_journal
from drivers.kuka_rsi.robot.kuka_robot import KukaRobot
from procedures.steps.tracker.rows import CorrectionEndRow, CorrectionLogRow, TrackerVerdict

pytestmark = pytest.mark.campaign

MODEL = CorrectionModel("m1", {name: tuple(values) for name, values in wavy_model(0.5, span_deg=170.0).items()})
HERE, THERE = (5.0, -65.0, 95.0, 5.0, 65.0, 5.0), (15.0, -60.0, 90.0, 15.0, 75.0, -15.0)
NEAR_DEG = 0.001


def heavy_with(folder: Path, *faults: str) -> Path:
    """The heavy cell with these faults."""
    text = HEAVY_CELL.read_text().replace("../robots/", f"{HEAVY_CELL.parents[1]}/robots/")
    text = text.replace("ethernet=../../cells/", f"ethernet={ROOT}/procedures/cells/")
    lines = "".join(f"    - {{{fault}}}\n" for fault in faults)
    path = folder / "cell.yaml"
    path.write_text(text.rstrip() + ("\n  faults:\n" + lines if faults else "\n"))
    return path


def test_moves_end_where_program_and_correction_put_them_and_without_it_where_the_program_does(tmp_path):
    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            robot = bench.robot
            await robot.move(HERE, 50)
            await robot.correction_on(MODEL)
            await robot.move(THERE, 50)
            await bench.clock.sleep(4)
            corrected, samples = await robot.joints(), robot.correction_samples()
            report = await robot.correction_off()
            return corrected, report, samples, await robot.move(HERE, 50)

    corrected, report, samples, after = asyncio.run(go())
    offset = tuple(a - b for a, b in zip(corrected, THERE, strict=True))
    assert max(map(abs, offset)) > 0.02
    assert samples[-1].programmed == pytest.approx(THERE, abs=NEAR_DEG)
    assert samples[-1].correction == pytest.approx(offset, abs=NEAR_DEG)
    assert (report.late, report.lost, report.refused_models) == (0, 0, 0)
    assert after == pytest.approx(HERE, abs=NEAR_DEG)


@pytest.mark.parametrize(
    ("fault", "error"),
    [("fault: rsi.stall, at_ms: 4000, for_ms: 3000", DeviceError), ("fault: robot.restart, at_ms: 4000", DeviceLost)],
)
def test_a_lost_rsi_or_controller_ends_the_correction_and_the_robot_is_held(tmp_path, fault, error):
    async def go():
        async with simulated_robot(heavy_with(tmp_path, fault)) as bench:
            robot = bench.robot
            await robot.move(HERE, 50)
            await robot.correction_on(MODEL)
            with pytest.raises(error):
                await _there_and_back(robot)

    asyncio.run(go())


async def _there_and_back(robot: KukaRobot) -> None:
    for target in (THERE, HERE) * 20:
        await robot.move(target, 20)


def test_a_stop_holds_the_robot_and_rsi_is_off(tmp_path):
    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            robot = bench.robot
            await robot.move(HERE, 50)
            await robot.correction_on(MODEL)
            await bench.clock.sleep(2)
            before = await robot.joints()
            await robot.stop()
            held = await robot.joints()
            assert robot.correction_id() == ""
            with pytest.raises(DeviceRefused, match="no on-line correction is on"):
                await robot.correction_off()
            robot.clear_stop()
            await robot.correction_on(MODEL)
            with pytest.raises(DeviceRefused, match="an on-line correction is on"):
                await robot.search((6.0, *HERE[1:]), 1.0)
            await robot.correction_off()
            return before, held, await robot.move(HERE, 50)

    before, held, after = asyncio.run(go())
    assert held == pytest.approx(before, abs=NEAR_DEG)
    assert after == pytest.approx(HERE, abs=NEAR_DEG)


@pytest.mark.long
def test_80_held_out_targets_are_reached_within_015_mm_with_on_line_correction(tmp_path):
    settings = {
        "model_run": calibrated(1, tmp_path),
        "target_file": TARGETS,
        "targets": 80,
        "two_face_limit": 0.2,
    }
    given = [part for name, value in settings.items() for part in ("--set", f"{name}={value}")]
    done = cellctl("run", "online_correction", "--cell", HEAVY_CELL, "--seed", "1", "--runs", tmp_path / "runs", *given)
    assert done.returncode == 0, done.stderr
    journal = fold(read_journal(only_run(tmp_path / "runs")))
    verdict = journal.recorded(TrackerVerdict)[-1]
    assert verdict.targets.n == 80
    assert verdict.targets.before.mean > 0.5
    assert verdict.targets.after.max <= MOST_MM
    assert all(row.late == row.lost == 0 for row in journal.recorded(CorrectionEndRow))
    assert len(journal.recorded(CorrectionLogRow)) == 80
