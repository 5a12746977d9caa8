"""Whatever stops a UR in a move is named; a stop that nobody confirmed is uncertain."""

from __future__ import annotations

import asyncio
import socket

import pytest

from cellctl.devices import DeviceError, DeviceFault, DeviceLost, DeviceRefused, DeviceUncertain
from tests.drivers.ur_rtde.conftest import HOME

FAR = (150.0, -70.0, 90.0, -80.0, -60.0, 40.0)


async def moved_into(wire, fault, **settings):
    """The error of a slow move in which this happens."""
    task = asyncio.create_task(wire.robot.move(FAR, 3))
    await wire.clock.sleep(1.0)
    await wire.fault(fault, **settings)
    with pytest.raises(DeviceError) as error:
        await task
    return error.value


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("ur.protective_stop", "protective stop"),
        ("safety.emergency_stop", "emergency stop (robot)"),
        ("safety.guard_open", "safeguard stop"),
        ("ur.power_off", "power off"),
        ("ur.stop", "the program was ended"),
    ],
)
def test_each_stop_is_named_and_nothing_moves_afterwards(on_wire, fault, named):
    async def work(wire):
        error = await moved_into(wire, fault)
        stands, health = await wire.stands(), await wire.robot.health()
        with pytest.raises(DeviceRefused) as refusal:
            await wire.robot.move(HOME, 10)
        return error, stands, health, str(refusal.value)

    error, stands, health, refusal = on_wire(work)
    assert isinstance(error, DeviceFault)
    assert named in error.what
    assert stands
    assert not health.ok
    assert health.text.split(";")[0] in refusal


def test_a_protective_stop_is_ended_at_the_pendant_and_the_move_it_broke_does_not_go_on(on_wire):
    async def work(wire):
        await moved_into(wire, "ur.protective_stop")
        await wire.clock.sleep(6.0)
        before = await wire.robot.joints()
        await wire.tell({"op": "acknowledge", "device": "robot"})
        await wire.clock.sleep(1.0)
        return before, await wire.robot.joints(), (await wire.robot.health()).text, await wire.robot.move(HOME, 20)

    before, after, text, reached = on_wire(work)
    assert max(abs(a - b) for a, b in zip(before, after, strict=True)) < 0.01
    assert text == "running, resident program runs"
    assert max(abs(a - b) for a, b in zip(reached, HOME, strict=True)) < 0.01


def test_in_local_control_nothing_is_begun(on_wire):
    async def work(wire):
        await wire.fault("ur.local", for_ms=60000)
        health = await wire.robot.health()
        with pytest.raises(DeviceRefused, match="the pendant is in local control"):
            await wire.robot.move(FAR, 10)
        return health, await wire.robot.joints()

    health, joints = on_wire(work)
    assert (health.ok, health.mode) == (False, "local")
    assert max(abs(a - b) for a, b in zip(joints, HOME, strict=True)) < 1e-3


def test_a_computer_that_is_silent_stops_the_robot(on_wire):
    async def work(wire):
        begun = wire.clock.now()
        error = await moved_into(wire, "ur.stall", for_ms=2000)
        return error, wire.clock.now() - begun, await wire.stands()

    error, seconds, stands = on_wire(work)
    assert isinstance(error, DeviceFault | DeviceLost)
    assert seconds < 4.0
    assert stands


def test_a_line_without_data_is_lost_and_the_stop_confirmed_by_another_one(on_wire):
    async def work(wire):
        error = await moved_into(wire, "ur.drop", for_ms=700)
        return error, await wire.stands()

    error, stands = on_wire(work)
    assert type(error) is DeviceLost
    assert "no data came for 0.5 s" in error.what
    assert stands


def test_a_stop_that_no_connection_confirms_is_uncertain(on_wire):
    async def work(wire):
        return await moved_into(wire, "ur.reboot")

    error = on_wire(work)
    assert isinstance(error, DeviceUncertain)
    assert "has not confirmed that the robot stands" in error.what


def test_after_an_uncertain_stop_a_new_connection_confirms_it_before_anything_moves(on_wire):
    async def work(wire):
        error = await moved_into(wire, "ur.reboot")
        await wire.clock.sleep(25.0)
        await wire.robot.close()
        await wire.robot.connect()
        await wire.robot.stop()
        await wire.tell({"op": "acknowledge", "device": "robot"})
        await wire.clock.sleep(0.1)
        return error, await wire.robot.move(HOME, 20)

    error, reached = on_wire(work)
    assert isinstance(error, DeviceUncertain)
    assert max(abs(a - b) for a, b in zip(reached, HOME, strict=True)) < 0.01


def test_a_clock_that_jumps_ends_the_move_and_the_robot_stands(on_wire):
    async def work(wire):
        error = await moved_into(wire, "ur.clock_jump", ms=2000)
        return error, await wire.stands()

    error, stands = on_wire(work)
    assert type(error) is DeviceLost
    assert "clock jumped by" in error.what
    assert stands


def test_registers_of_another_client_are_refused(on_wire):
    async def work(wire):
        await wire.fault("ur.second_client", for_ms=60000)
        await wire.clock.sleep(0.1)
        with pytest.raises(DeviceRefused, match="another program writes input_int_register_24"):
            await wire.robot.connect()

    on_wire(work, connect=False)


def test_a_program_of_other_limits_is_refused(on_wire):
    def other(script):
        return script.replace("write_output_integer_register(25, ", "write_output_integer_register(25, 1 + ")

    async def work(wire):
        health = await wire.robot.health()
        with pytest.raises(DeviceRefused, match="is not the one that `cellctl krl` writes for this cell"):
            await wire.robot.move(FAR, 10)
        return health, await wire.robot.joints()

    health, joints = on_wire(work, script=other)
    assert not health.ok
    assert max(abs(a - b) for a, b in zip(joints, HOME, strict=True)) < 1e-3


def test_a_foreign_program_that_took_its_place_is_refused(on_wire):
    program = b"def other():\n  while True:\n    sync()\n  end\nend\n"

    async def work(wire):
        with wire.clock.standing(), socket.create_connection((wire.host, 30002), timeout=60) as stranger:
            stranger.sendall(program)
            stranger.shutdown(socket.SHUT_WR)
            while stranger.recv(4096):
                pass
        await wire.clock.sleep(0.5)
        with pytest.raises(DeviceRefused, match="is not the one"):
            await wire.robot.move(FAR, 10)
        return await wire.robot.joints()

    joints = on_wire(work)
    assert max(abs(a - b) for a, b in zip(joints, HOME, strict=True)) < 1e-3


def test_a_digest_that_stayed_in_the_registers_is_not_the_program(on_wire):
    def deaf(script):
        return script.replace("    write_output_integer_register(29, read_input_integer_register(24))\n", "")

    async def work(wire):
        with pytest.raises(DeviceRefused, match="the program that runs does not answer"):
            await wire.robot.move(FAR, 10)
        return await wire.robot.joints()

    joints = on_wire(work, script=deaf)
    assert max(abs(a - b) for a, b in zip(joints, HOME, strict=True)) < 1e-3


def test_a_job_that_arrived_changed_moves_nothing(on_wire):
    def deaf(script):
        return script.replace("check = number + 2 * kind", "check = 1 + number + 2 * kind")

    async def work(wire):
        with pytest.raises(DeviceFault, match="does not fit its check"):
            await wire.robot.move(FAR, 10)
        return await wire.robot.joints()

    assert max(abs(a - b) for a, b in zip(on_wire(work, script=deaf), HOME, strict=True)) < 1e-3
