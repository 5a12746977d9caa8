"""The drives of a simulated cell over the wire in lockstep, beside the robot that moves them; a test for each fault."""

import asyncio

import pytest

from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused
from tests.helpers.simulated_robots import DRIVES, HOME, cell_file, drive_cell

TILTED = (0.0, -60.0, 90.0, 20.0, 45.0, 0.0)


@pytest.fixture
def in_cell(tmp_path):
    """Runs a coroutine function on a connected cell."""

    def run(story, simulate=None, devices=None):
        async def go():
            async with drive_cell(cell_file(tmp_path, simulate, devices)) as cell:
                await cell.connect()
                return await story(cell)

        return asyncio.run(go())

    return run


def moved(axis, degrees):
    return tuple(joint + (degrees if index == axis else 0.0) for index, joint in enumerate(HOME))


async def from_both_sides(cell, source, axis=1, way=2.0):
    """Currents at home, approached from below and from above with one axis."""
    found = []
    for side in (-way, way):
        await cell.robot.move(moved(axis, side), 50.0)
        await cell.robot.move(HOME, 50.0)
        found.append(await source.currents(25))
    return found


def test_the_drives_say_that_they_are_simulated(in_cell):
    async def story(cell):
        identity = await cell.drives.connect()
        assert identity.simulated
        assert identity.serial.startswith("SIM-")
        assert (await cell.drives.health()).ok

    in_cell(story)


def test_friction_shows_in_the_two_directions_of_approach_and_the_weight_in_their_mean(in_cell):
    async def story(cell):
        below, above = await from_both_sides(cell, cell.drives)
        differences = [a - b for a, b in zip(below.amperes, above.amperes, strict=True)]
        assert 0.5 < differences[1] < 0.9  # twice 0.25 … 0.45 A
        assert all(abs(other) < 0.05 for axis, other in enumerate(differences) if axis != 1)
        await cell.robot.move(TILTED, 50.0)
        elsewhere = await cell.drives.currents(25)
        assert abs(elsewhere.amperes[2] - below.amperes[2]) > 0.05  # another moment of the weight

    in_cell(story)


def test_currents_after_the_brakes_have_closed_are_refused(in_cell):
    async def story(cell):
        await cell.robot.move(TILTED, 50.0)
        await cell.clock.sleep(1.0)
        await cell.drives.currents(10)
        await cell.clock.sleep(2.5)
        with pytest.raises(DeviceRefused, match="'switched on': its brake is closed") as caught:
            await cell.drives.currents(10)
        assert "before the brakes close" in caught.value.cure
        await cell.robot.move(HOME, 50.0)
        await cell.drives.currents(10)

    in_cell(story, {"drives": {"brakes_after_s": 3}})


@pytest.mark.long
def test_the_same_seed_gives_the_same_currents_at_the_same_time(in_cell):
    async def story(cell):
        await cell.robot.move(TILTED, 50.0)
        return [await cell.drives.currents(10), await cell.drives.currents(5), cell.clock.now_ns()]

    assert in_cell(story, {"seed": 4}) == in_cell(story, {"seed": 4})


def test_a_drive_that_reboots_in_the_middle_of_sampling_ends_it(in_cell):
    async def story(cell):
        with pytest.raises(DeviceLost, match=r"A3 \(node 3\) is silent"):
            await cell.drives.currents(20)
        await cell.clock.sleep(1.0)
        with pytest.raises(DeviceFault, match=r"A3 \(node 3\) has restarted") as caught:
            await cell.drives.currents(20)
        assert "connect again" in caught.value.cure
        assert "has restarted" in (await cell.drives.health()).text
        await cell.drives.connect()
        await cell.robot.move(TILTED, 50.0)  # its power comes back with the next motion
        assert (await cell.drives.currents(5)).samples == 5

    in_cell(story, {"faults": [{"fault": "drives.reboot", "node": 3, "event": "drives.sync", "count": 10}]})


def test_an_emcy_is_a_fault_with_its_code(in_cell):
    async def story(cell):
        await cell.fault("drives.emcy", node=5)
        await cell.clock.sleep(0.1)
        with pytest.raises(DeviceFault, match=r"A5 \(node 5\) reports a fault: EMCY 0x4310 \(Temperature\)"):
            await cell.drives.currents(5)
        health = await cell.drives.health()
        assert not health.ok
        assert "A5 (node 5) fault" in health.text

    in_cell(story)


def test_a_silent_drive_is_lost_and_can_come_back(in_cell):
    async def story(cell):
        before = cell.clock.now()
        await cell.fault("drives.silent", node=2, for_ms=500)
        with pytest.raises(DeviceLost, match=r"A2 \(node 2\) is silent: no answer to SYNC within 100 ms"):
            await cell.drives.currents(5)
        assert cell.clock.now() - before < 0.2
        await cell.clock.sleep(1.0)
        assert (await cell.drives.currents(5)).samples == 5

    in_cell(story)


def test_a_drive_without_heartbeat_is_lost(in_cell):
    async def story(cell):
        await cell.fault("drives.silent", node=2)
        await cell.clock.sleep(4.0)
        with pytest.raises(DeviceLost, match=r"A2 \(node 2\) is silent: no heartbeat for [34]"):
            await cell.drives.currents(5)

    in_cell(story)


def test_drives_send_nothing_but_heartbeats_while_nobody_asks(in_cell):
    async def story(cell):
        from drivers.canopen_drives.line import CanLine

        seen = []
        take = CanLine._take
        CanLine._take = lambda line, can_id, data: (seen.append(can_id & 0x780), take(line, can_id, data))[1]
        try:
            await cell.clock.sleep(10.0)
        finally:
            CanLine._take = take
        frames = [function for function in seen if function in (0x180, 0x280, 0x580, 0x700)]
        assert set(frames) == {0x700}
        assert len(frames) <= 6 * 11

    in_cell(story, devices={"drives": DRIVES})
