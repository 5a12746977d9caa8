"""On-line correction over the wires: held-out targets before and after, and faults in mid-correction."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from pathlib import Path

import pytest

from cellctl.devices import CorrectionModel, DeviceError, DeviceFault, DeviceLost, DeviceRefused
from tests.helpers.krc import wavy_model
from tests.helpers.runs import ROOT, child
from tests.helpers.simulated_robots import (
    HEAVY_CELL,
    HERE,
    MODEL,
    PERCENT,
    THERE,
    corrected_from_here,
    simulated_robot,
    there_and_back,
    watched_cell,
    watched_robot,
)

pytestmark = pytest.mark.campaign

NEAR_DEG = 0.001
STEP_DEG = 175.0 * PERCENT / 100 * 0.004 + 0.5 * 0.004 + 1e-6
"""In a cycle of 4 ms: the move at the fastest axis's speed, and the correction's rate. The correction is 0.11 deg."""


def heavy_with(folder: Path, *faults: str) -> Path:
    """The heavy cell with these faults."""
    text = HEAVY_CELL.read_text().replace("../robots/", f"{HEAVY_CELL.parents[1]}/robots/")
    text = text.replace("ethernet=../../cells/", f"ethernet={ROOT}/procedures/cells/")
    lines = "".join(f"    - {{{fault}}}\n" for fault in faults)
    path = folder / "cell.yaml"
    path.write_text(text.rstrip() + ("\n  faults:\n" + lines if faults else "\n"))
    return path


@pytest.mark.long
def test_moves_end_where_program_and_correction_put_them_and_without_it_where_the_program_does(tmp_path):
    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            robot = bench.robot
            await corrected_from_here(robot)
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


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "error"),
    [("fault: rsi.stall, at_ms: 4000, for_ms: 3000", DeviceError), ("fault: robot.restart, at_ms: 4000", DeviceLost)],
)
def test_a_lost_rsi_or_controller_ends_the_correction_and_the_robot_is_held_without_a_leap(tmp_path, fault, error):
    async def go():
        async with watched_robot(heavy_with(tmp_path, fault)) as (bench, watched):
            robot = bench.robot
            await corrected_from_here(robot)
            await bench.clock.sleep(0.5)
            watched.joints.clear()
            with pytest.raises(error):
                await there_and_back(robot)
            await bench.clock.sleep(1.0)
            assert watched.held()
            assert watched.largest_step() <= STEP_DEG

    asyncio.run(go())


OTHER = CorrectionModel("other", {name: tuple(values) for name, values in wavy_model(-0.5, span_deg=170.0).items()})
LIMIT_DEG = 1.5
"""Of the heavy cell's file."""

NARROW = CorrectionModel("narrow", {**MODEL.arrays, "upper": (10.0, *[170.0] * 5)})
LARGE = CorrectionModel("large", {name: tuple(values) for name, values in wavy_model(5.0, span_deg=170.0).items()})


@pytest.mark.long
@pytest.mark.parametrize("model", [OTHER, NARROW, LARGE], ids=["swapped", "outside the region", "at the limit"])
def test_a_model_that_arrives_in_mid_motion_makes_no_leap(tmp_path, model):
    async def go():
        async with watched_robot(heavy_with(tmp_path)) as (bench, watched):
            robot = bench.robot
            await corrected_from_here(robot)
            await bench.clock.sleep(2)
            watched.joints.clear()
            moving = asyncio.create_task(robot.move(THERE, PERCENT))
            await bench.clock.sleep(0.5)
            robot.replace_correction_model(model)
            await moving
            await bench.clock.sleep(4)
            assert watched.largest_step() <= STEP_DEG
            offset = [a - b for a, b in zip(await robot.joints(), THERE, strict=True)]
            return offset, await robot.correction_off()

    offset, report = asyncio.run(go())
    largest = max(map(abs, offset))
    assert (report.late, report.lost, report.refused_models) == (0, 0, 0)
    if model is NARROW:
        assert largest <= NEAR_DEG
        assert report.outside > 0
    elif model is LARGE:
        assert 0.8 * LIMIT_DEG < largest <= LIMIT_DEG
        assert report.limited > 0
    else:
        assert 0.02 < largest < 0.4


ENGINE = """
import asyncio, json, sys
sys.path[:0] = sys.argv[3:]
from pathlib import Path
from cellctl.operations.cell_devices import SimulatedCell
from tests.helpers.simulated_robots import robot_of
from tests.helpers.simulated_robots import corrected_from_here, there_and_back

async def main():
    simulated = SimulatedCell(None, None, json.loads(sys.argv[2]))
    async with robot_of(Path(sys.argv[1]), simulated) as bench:
        await corrected_from_here(bench.robot)
        await bench.clock.sleep(2)
        print("corrected", flush=True)
        await there_and_back(bench.robot)

asyncio.run(main())
"""


@pytest.mark.long
def test_an_engine_killed_in_mid_correction_leaves_a_robot_that_is_held_without_a_leap(tmp_path):
    cell = heavy_with(tmp_path)
    with watched_cell(cell) as watched:
        given = [str(cell), json.dumps(watched.cell.ready), str(ROOT)]
        with child([sys.executable, "-c", ENGINE, *given], stdout=subprocess.PIPE, cwd=ROOT) as engine:
            assert engine.stdout
            assert engine.stdout.readline() == b"corrected\n"
            watched.joints.clear()
            watched.let_pass(1.0)
            engine.kill()
        moved = len(watched.joints)
        watched.let_pass(5.0)
        assert len(set(watched.joints[:moved])) > 1, "it was killed while the robot moved"
        assert watched.held()
        assert watched.largest_step() <= STEP_DEG


@pytest.mark.long
def test_a_stop_holds_the_robot_and_rsi_is_off(tmp_path):
    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            robot = bench.robot
            await corrected_from_here(robot)
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
def test_a_correction_that_ended_at_the_pendant_is_not_taken_for_one_that_is_on(tmp_path):
    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            robot = bench.robot
            await corrected_from_here(robot)
            await bench.clock.sleep(1)
            await robot.reset()
            await bench.clock.sleep(2)
            with pytest.raises(DeviceLost, match="RSI is off: no telegram came for"):
                await robot.move(THERE, 50)
            assert robot.correction_id() == ""
            robot.clear_stop()
            await robot.correction_on(MODEL)
            await robot.move(THERE, 50)
            return await robot.correction_off()

    assert asyncio.run(go()).cycles > 0


@pytest.mark.long
def test_after_a_message_of_the_controller_it_is_off_and_can_be_switched_on_again(tmp_path):
    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            robot = bench.robot
            await corrected_from_here(robot)
            await bench.simulated.tell({"op": "fault", "fault": "safety.guard_open", "for_ms": 500})
            await bench.clock.sleep(1)
            assert robot.correction_id() == ""
            with pytest.raises(DeviceFault, match=r"safety fence open; the on-line correction is off"):
                await robot.correction_off()
            with pytest.raises(DeviceRefused, match="no on-line correction is on"):
                await robot.correction_off()
            await robot.reset()
            await robot.correction_on(MODEL)
            assert robot.correction_id() == MODEL.id
            return await robot.correction_off()

    assert asyncio.run(go()).cycles > 0


@pytest.mark.long
def test_switched_off_while_the_robot_moves_it_fades_and_ends_with_the_motion(tmp_path):
    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            robot = bench.robot
            await corrected_from_here(robot)
            moving = asyncio.create_task(robot.move(THERE, PERCENT))
            await bench.clock.sleep(1)
            ending = asyncio.create_task(robot.correction_off())
            await bench.clock.sleep(0.8)
            assert not any(robot._lines.process.block.online.status().correction)
            assert not moving.done(), "it fades during the motion"
            await moving
            await ending
            return robot.correction_id()

    assert asyncio.run(go()) == ""


@pytest.mark.long
def test_a_model_over_the_limit_everywhere_is_refused_and_rsi_stays_off(tmp_path):
    model = CorrectionModel("far off", {name: tuple(values) for name, values in wavy_model(80.0).items()})

    async def go():
        async with simulated_robot(heavy_with(tmp_path)) as bench:
            with pytest.raises(DeviceRefused, match=r"over the limit of \S+ deg in all of its measured region"):
                await bench.robot.correction_on(model)
            assert bench.robot.correction_id() == ""
            await bench.robot.move(HERE, 50)

    asyncio.run(go())
