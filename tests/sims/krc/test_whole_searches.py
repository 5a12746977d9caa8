"""Searches of the real driver in the whole simulated cell: every monitor of the controller looks on."""

from __future__ import annotations

import asyncio
import itertools
import json
import re
import socket
import threading
from contextlib import asynccontextmanager

import pytest

from cellctl.clock import LockstepClock
from cellctl.devices import Address, DeviceFault, DeviceRefused, SearchEnd, Surroundings
from drivers.kuka_rsi.description import open_robot
from sims.cell import read_cell
from sims.running import RunningCell

PATIENCE_S = 120.0
LIMITS = {"correction_deg": 5, "speed_deg_s": 5, "acceleration_deg_s2": 50, "jerk_deg_s3": 1000, "travel_deg": 5}
END = (0.0, -88.0, 90.0, 0.0, 45.0, 0.0)


@pytest.fixture
def cell(request, tmp_path):
    """The shipped cell without its probe; `simulated(mode, cycle, section)` runs it in a thread.

    It returns its ready file.
    """
    running = []

    def simulated(mode, cycle="ipo_fast", section=""):
        cells = request.config.rootpath / "procedures/cells"
        text = (cells / "sphere_cell.yaml").read_text().replace("../robots", str(cells.parent / "robots"))
        text = re.sub(r"(?m)^probe:.*\n", "", text).replace(
            "eki=172.31.1.147:54600", f"eki=h:1&mode={mode}&cycle={cycle}"
        )
        (tmp_path / "cell.yaml").write_text(text + section + "\n")
        ethernet = (cells / "rsi_ethernet.xml").read_text()
        if mode == "relative":
            ethernet = ethernet.replace('HOLDON="1"', 'HOLDON="0"')
        (tmp_path / "rsi_ethernet.xml").write_text(ethernet)
        cell = RunningCell(read_cell(tmp_path / "cell.yaml"))
        thread = threading.Thread(target=cell.run, daemon=True)
        thread.start()
        running.append((cell, thread))
        return cell.ready

    yield simulated
    for cell, thread in running:
        cell.kernel.stop()
        thread.join(PATIENCE_S)
        cell.close()


@asynccontextmanager
async def connected(ready, folder):
    host, _, port = ready["control"].rpartition(":")
    clock = await LockstepClock.attach(ready["time"]["source"].removeprefix("file:"), host, int(port))
    robot = open_robot("robot", Address.parse(ready["robot"]), Surroundings(clock, folder, LIMITS, reach_mm=1400.0))
    try:
        await robot.connect()
        with socket.create_connection((host, int(port))) as control:
            target = {"op": "rsi_target", "device": "robot", "host": "127.0.0.1", "port": robot.listening()[1]}
            control.sendall(json.dumps(target).encode() + b"\n")
            await asyncio.to_thread(control.recv, 100)
        yield robot, clock
    finally:
        await robot.close()
        await clock.aclose()


@pytest.mark.parametrize("mode", ["absolute", "relative"])
@pytest.mark.parametrize(("cycle", "cycle_ms"), [("ipo_fast", 4), ("ipo", 12)])
def test_a_search_at_5_deg_s_to_its_end_and_one_that_is_stopped_pass_every_monitor(
    cell, tmp_path, mode, cycle, cycle_ms
):
    ready = cell(mode, cycle)

    async def work():
        async with asyncio.timeout(PATIENCE_S), connected(ready, tmp_path) as (robot, clock):
            there = await robot.search(END, 5.0)

            async def touch():
                await clock.sleep(0.3)
                robot.stop_now()

            back, _ = await asyncio.gather(robot.search((0.0, -90.0, 90.0, 0.0, 45.0, 0.0), 5.0), touch())
            return there, back

    there, back = asyncio.run(work())
    assert there.end is SearchEnd.TRAVEL
    assert {b - a for a, b in itertools.pairwise(there.times_ns)} == {cycle_ms * 1_000_000}
    assert there.resting == pytest.approx(END, abs=0.002)
    assert (there.late, back.late) == (0, 0)
    assert (back.end, back.stop_cycles) == (SearchEnd.STOPPED, 2)
    assert -89.9 < back.resting[1] < -88.1


@pytest.mark.parametrize(
    ("mode", "program", "what"), [("absolute", "relative", "ran ahead"), ("relative", "absolute", "too far behind")]
)
def test_a_program_with_another_mode_than_the_address_that_does_not_say_so_is_left_on_the_way(
    cell, tmp_path, mode, program, what
):
    ready = cell(mode, section=f"  rsi: {{mode: {program}, hello: short}}")

    async def work():
        async with asyncio.timeout(PATIENCE_S), connected(ready, tmp_path) as (robot, _):
            with pytest.raises(DeviceFault, match=what):
                await robot.search(END, 2.0)
            return await robot.joints()

    assert -90.01 < asyncio.run(work())[1] < -88.0  # AXISCORR would have let it go to -85


@pytest.mark.parametrize(("cycle", "program_ms"), [("ipo_fast", 12), ("ipo", 4)])
def test_a_program_with_another_cycle_than_the_address_that_does_not_say_so_is_left_before_any_motion(
    cell, tmp_path, cycle, program_ms
):
    ready = cell("absolute", cycle, f"  rsi: {{cycle_ms: {program_ms}, hello: short}}")

    async def work():
        async with asyncio.timeout(PATIENCE_S), connected(ready, tmp_path) as (robot, _):
            before = await robot.joints()
            with pytest.raises(DeviceFault, match=f"telegrams come every {program_ms} ms, .* cycle={cycle} "):
                await robot.search(END, 2.0)
            return before, await robot.joints()

    before, after = asyncio.run(work())
    assert after == pytest.approx(before, abs=1e-3)


@pytest.mark.parametrize(
    ("mode", "cycle", "program", "what"),
    [
        ("absolute", "ipo", "mode: relative", "RSI_ON(#RELATIVE,#IPO), and the address mode=absolute"),
        (
            "relative",
            "ipo_fast",
            "cycle_ms: 12",
            "RSI_ON(#RELATIVE,#IPO), and the address mode=relative and cycle=ipo_fast (4 ms)",
        ),
        ("absolute", "ipo_fast", "mode: relative, cycle_ms: 12", "RSI_ON(#RELATIVE,#IPO), and the address"),
    ],
)
def test_a_program_that_says_another_mode_or_cycle_than_the_address_is_refused_at_connect(
    cell, tmp_path, mode, cycle, program, what
):
    ready = cell(mode, cycle, f"  rsi: {{{program}}}")

    async def work():
        with pytest.raises(DeviceRefused, match=re.escape(what)) as refused:
            async with asyncio.timeout(PATIENCE_S), connected(ready, tmp_path):
                pass
        return refused.value

    assert "`cellctl krl`" in asyncio.run(work()).cure
