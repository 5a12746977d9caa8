"""Moves through driver, wire and simulated controller: where they end, and how they are stopped."""

from __future__ import annotations

import asyncio

import pytest

from cellctl.devices import (
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    FileStore,
    LimitExceeded,
    TableRobot,
    VariableStore,
)

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
NEAR = (5.0, -85.0, 88.0, 3.0, 40.0, -4.0)
FAR = (60.0, -60.0, 60.0, 30.0, 30.0, 90.0)


def near(joints, target):
    return max(abs(a - b) for a, b in zip(joints, target, strict=True)) < 0.01


async def at_rest(wire, robot):
    """The joints after a second in which they do not change."""
    before = await robot.joints()
    await wire.clock.sleep(1.0)
    after = await robot.joints()
    return after if near(before, after) else None


def test_identity_health_and_joints_are_the_simulated_controllers(on_wire):
    async def work(wire):
        assert isinstance(wire.robot, TableRobot)
        assert isinstance(wire.robot, VariableStore)
        assert isinstance(wire.robot, FileStore)
        assert wire.identity.simulated
        assert wire.identity.serial.startswith("SIM-")
        assert "C3 BRIDGE" in wire.identity.firmware
        health = await wire.robot.health()
        assert health.ok
        assert 3.0 < health.figures["latency_ms"] < 40.0
        assert await wire.robot.holds("ready")
        assert near(await wire.robot.joints(), HOME)

    on_wire(work)


def test_moves_end_at_their_targets_one_after_the_other(on_wire):
    async def work(wire):
        for target in (NEAR, HOME, NEAR):
            arrived = await wire.robot.move(target, 20.0)
            assert near(arrived, target)
        assert near(await wire.robot.joints(), NEAR)

    on_wire(work)


def test_a_move_outside_the_limits_is_not_sent(on_wire):
    async def work(wire):
        for target, percent, said in (
            ((0.0, -90.0, 90.0, 0.0, 400.0, 0.0), 10.0, "A5 400.0000 deg is outside"),
            ((0.0, -90.0, 90.0, 0.0, float("nan"), 0.0), 10.0, "are not 6 joint readings"),
            (NEAR, 31.0, "not within 1 … 30 %"),
            (NEAR, 0.5, "not within"),
        ):
            with pytest.raises(LimitExceeded, match=said):
                await wire.robot.move(target, percent)
            assert await wire.robot.read_variable("KV_GO") == "0"

    on_wire(work)


def test_a_cancelled_move_stands_before_the_cancellation_goes_on(on_wire):
    async def work(wire):
        move = asyncio.create_task(wire.robot.move(FAR, 10.0))
        await wire.clock.sleep(1.5)
        move.cancel()
        with pytest.raises(asyncio.CancelledError):
            await move
        rest = await at_rest(wire, wire.robot)
        assert rest
        assert not near(rest, FAR)
        assert near(await wire.robot.move(HOME, 20.0), HOME)

    on_wire(work)


def test_stop_during_a_move_holds_the_robot_and_the_move_says_so(on_wire):
    async def work(wire):
        move = asyncio.create_task(wire.robot.move(FAR, 10.0))
        await wire.clock.sleep(1.5)
        await wire.robot.stop()
        with pytest.raises(DeviceFault, match="stop flag"):
            await move
        assert await at_rest(wire, wire.robot)

    on_wire(work)


def test_the_robot_stops_by_itself_when_the_computer_is_silent(on_wire):
    async def work(wire):
        move = asyncio.create_task(wire.robot.move(FAR, 5.0))
        await wire.clock.sleep(1.5)
        await wire.fault("varproxy.gone", for_ms=4000)
        with pytest.raises(DeviceUncertain, match="not confirmed that the robot stands") as caught:
            await move
        assert "1.5 s" in caught.value.cure
        with pytest.raises(DeviceUncertain):
            await wire.robot.stop()
        await wire.clock.sleep(4.0)
        await wire.second.connect()
        rest = await at_rest(wire, wire.second)
        assert rest
        assert not near(rest, FAR)
        assert await wire.second.read_variable("KV_OUTCOME") == "30"
        await wire.second.close()

    on_wire(work)


@pytest.mark.parametrize("fault", ["varproxy.slow", "varproxy.cut"])
def test_a_line_in_doubt_ends_the_move_and_the_robot_is_held(on_wire, fault):
    async def work(wire):
        move = asyncio.create_task(wire.robot.move(FAR, 5.0))
        await wire.clock.sleep(1.5)
        await wire.fault(fault, **({} if fault == "varproxy.cut" else {"for_ms": 3000}))
        with pytest.raises(DeviceLost):
            await move
        await wire.clock.sleep(12.0)
        await wire.second.connect()
        rest = await at_rest(wire, wire.second)
        assert rest
        assert not near(rest, FAR)
        await wire.second.close()

    on_wire(work)


def test_a_message_of_the_controller_ends_the_move_and_keeps_others_from_starting(on_wire):
    async def work(wire):
        move = asyncio.create_task(wire.robot.move(FAR, 10.0))
        await wire.clock.sleep(1.5)
        await wire.fault("varproxy.stop")
        with pytest.raises(DeviceFault, match="shows a message"):
            await move
        assert await at_rest(wire, wire.robot)
        assert not (await wire.robot.health()).ok
        with pytest.raises(DeviceRefused, match="a message stands"):
            await wire.robot.move(HOME, 10.0)
        await wire.tell({"op": "acknowledge", "device": "robot"})
        assert near(await wire.robot.move(HOME, 20.0), HOME)

    on_wire(work)


def test_without_the_generated_program_health_says_so_and_nothing_moves(on_wire):
    async def work(wire):
        await wire.fault("varproxy.unloaded")
        health = await wire.robot.health()
        assert not health.ok
        assert "generated program" in health.text
        with pytest.raises(DeviceRefused, match="KV_VERSION"):
            await wire.robot.move(NEAR, 10.0)
        assert near(await wire.robot.joints(), HOME)

    on_wire(work)


def test_variables_are_written_and_read_back_but_not_those_of_moves_and_tables(on_wire):
    async def work(wire):
        await wire.robot.write_variable("$FLAG[7]", "TRUE")
        assert await wire.robot.read_variable("$FLAG[7]") == "TRUE"
        for name in ("KV_GO", "kv_roles", "KV_JOB.ROW", "$flag[ 413 ]", "$TIMER[20]"):
            with pytest.raises(DeviceRefused, match="belongs to moves and tables"):
                await wire.robot.write_variable(name, "1")
        with pytest.raises(DeviceRefused, match="cannot write"):
            await wire.robot.write_variable("$MODE_OP", "#T1")

    on_wire(work)


def test_a_file_is_written_in_parts_and_read_back(on_wire):
    content = bytes(range(256)) * 200

    async def work(wire):
        path = "KRC:\\R1\\PROGRAM\\cellctl_kvp.dat"
        await wire.robot.write_file(path, content)
        assert await wire.robot.read_file(path) == content
        await wire.robot.write_file(path, b"")
        assert await wire.robot.read_file(path) == b""
        with pytest.raises(DeviceRefused, match="refused by the server"):
            await wire.robot.read_file("KRC:\\R1\\nothing.dat")

    on_wire(work)


def test_kukavarproxy_has_variables_and_no_files(on_wire):
    async def work(wire):
        assert "KUKAVARPROXY" in wire.identity.firmware
        assert near(await wire.robot.move(NEAR, 20.0), NEAR)
        with pytest.raises(DeviceRefused, match="refused by the server") as caught:
            await wire.robot.write_file("KRC:\\R1\\PROGRAM\\a.dat", b"x")
        assert "C3 Bridge" in caught.value.cure

    on_wire(work, "varproxy: {proxy: kukavarproxy}")


def test_the_same_seed_gives_the_same_times_and_joints(on_wire):
    async def work(wire):
        arrived = await wire.robot.move(NEAR, 20.0)
        return arrived, wire.clock.now_ns()

    assert on_wire(work) == on_wire(work)
