"""What goes wrong on command, and how the controller is brought back."""

from __future__ import annotations

import socket
from itertools import pairwise
from math import radians

import pytest

from sims.ur._modes import RobotMode, RuntimeState, SafetyMode
from tests.sims.ur.conftest import DASHBOARD, PRIMARY, RTDE

HOME = [radians(angle) for angle in (0, -90, 90, -90, -90, 0)]
FAR = f"movej({[HOME[0] + 1.0, *HOME[1:]]}, a=2, v=0.5)"


def moving(begun):
    """The controller 0.5 s after a long move began."""
    begun.run(FAR, seconds=0.5)
    assert any(begun.motion.speed)
    return begun


def test_a_protective_stop_can_be_unlocked_after_five_seconds_and_the_move_goes_on(bench):
    begun = moving(bench(errors={}))
    begun.fault("ur.protective_stop")
    begun.let_pass(0.5)
    assert begun.motion.steady()
    assert begun.command("safetystatus") == "Safetystatus: PROTECTIVE_STOP"
    assert begun.command("programState") == "PAUSED <unnamed>"
    assert begun.command("play") == "Failed to execute: play"
    assert begun.command("unlock protective stop").startswith("Cannot unlock protective stop until 5s")
    begun.let_pass(5.0)
    assert begun.command("unlock protective stop") == "Protective stop releasing"
    assert begun.command("safetystatus") == "Safetystatus: NORMAL"
    assert begun.command("play") == "Starting program"
    begun.until(lambda: not begun.controller.runtime.active)
    begun.settle()
    assert begun.motion.actual()[0] == pytest.approx(HOME[0] + 1.0, abs=1e-6)


def test_its_bits_are_in_rtde(bench):
    begun = bench()
    client = begun.rtde()
    client.outputs("safety_status_bits", "safety_mode", "robot_status_bits", "runtime_state", frequency=50)
    client.start()
    assert client.package() == (1, 1, 1, 1)
    begun.run("sleep(100)", seconds=0.0)
    client.package()
    assert client.package() == (1, 1, 3, 2)
    begun.fault("ur.protective_stop")
    client.package()
    assert client.package() == (1 << 2 | 1 << 10, 3, 1, 4)


def test_an_emergency_stop_ends_the_program_and_takes_the_power(bench):
    begun = moving(bench(errors={}))
    begun.fault("safety.emergency_stop", for_ms=3000)
    begun.let_pass(0.5)
    assert begun.motion.steady()
    assert not begun.controller.runtime.active
    assert begun.command("safetystatus") == "Safetystatus: ROBOT_EMERGENCY_STOP"
    assert begun.command("robotmode") == "Robotmode: POWER_OFF"
    begun.let_pass(3.0)
    assert begun.command("safetystatus") == "Safetystatus: NORMAL"
    begun.command("brake release")
    begun.let_pass(7.1)
    assert begun.controller.ready


def test_an_open_guard_holds_the_program_until_it_is_played_again(bench):
    begun = moving(bench(errors={}))
    begun.fault("safety.guard_open", for_ms=2000)
    begun.let_pass(1.0)
    assert begun.command("safetystatus") == "Safetystatus: SAFEGUARD_STOP"
    assert begun.motion.steady()
    begun.let_pass(2.0)
    assert begun.controller.runtime.state is RuntimeState.PAUSED
    assert begun.command("play") == "Starting program"
    begun.until(lambda: not begun.controller.runtime.active)
    assert begun.motion.target[0] == pytest.approx(HOME[0] + 1.0)


def test_without_the_plc_s_enable_the_arm_is_held_as_with_an_open_guard(bench):
    begun = moving(bench(errors={}))
    begun.scene.safety.enable_motion(False)
    assert begun.controller.safety is SafetyMode.SAFEGUARD_STOP


def test_lost_packages_do_not_arrive_and_the_clock_shows_the_gap(bench):
    begun = bench()
    client = begun.rtde()
    client.outputs("timestamp")
    client.start()
    before = client.package()[0]
    begun.fault("ur.drop", for_ms=100)
    later = [client.package()[0] for _ in range(3)]
    assert max(b - a for a, b in pairwise([before, *later])) >= 0.1


@pytest.mark.parametrize(("action", "state"), [("stop", RuntimeState.STOPPED), ("pause", RuntimeState.PAUSED)])
def test_a_watchdog_acts_when_an_input_does_not_come(bench, action, state):
    begun = bench(errors={})
    client = begun.rtde()
    recipe, _ = client.inputs("input_int_register_0")
    client.start()
    begun.run(f'rtde_set_watchdog("input_int_register_0", 10, "{action}")\n{FAR}', seconds=0.0)
    for number in range(20):
        client.write(recipe, "i", number)
        begun.let_pass(0.03)
    assert begun.controller.runtime.state is RuntimeState.PLAYING
    begun.fault("ur.stall", for_ms=400)
    for number in range(20):
        client.write(recipe, "i", number)
        begun.let_pass(0.03)
    assert begun.controller.runtime.state is state
    begun.settle()
    assert begun.motion.actual()[0] < HOME[0] + 0.9


def test_a_watchdog_ends_with_its_program(bench):
    begun = bench()
    begun.run('rtde_set_watchdog("input_int_register_0", 10, "stop")\nsleep(0.05)')
    begun.run("sleep(1)", seconds=0.5)
    assert begun.controller.runtime.active


def test_an_unknown_action_of_a_watchdog_is_an_error(bench):
    assert "none of ignore, pause, stop" in bench().run('rtde_set_watchdog("input_int_register_0", 10, "shout")')[-1]


def test_the_operator_s_stop_ends_the_program(bench):
    begun = moving(bench(errors={}))
    begun.fault("ur.stop")
    begun.settle()
    assert begun.command("programState") == "STOPPED <unnamed>"
    assert begun.motion.actual()[0] < HOME[0] + 0.9


def test_somebody_switches_the_arm_off(bench):
    begun = moving(bench(errors={}))
    begun.fault("ur.power_off")
    begun.settle()
    assert begun.controller.mode is RobotMode.POWER_OFF


def test_a_restart_loses_connections_program_and_registers_and_takes_its_time(bench):
    begun = moving(bench(errors={}))
    client = begun.rtde()
    begun.board.outputs.ints[3] = 7
    begun.fault("ur.reboot")
    assert begun.received(client.client, 1) == b""
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection((begun.servers.host, DASHBOARD))
    begun.let_pass(20.5)
    begun._dashboard = None
    assert begun.command("robotmode") == "Robotmode: POWER_OFF"
    assert begun.controller.board.outputs.ints[3] == 0
    again = begun.rtde()
    again.outputs("timestamp")
    again.start()
    assert again.package()[0] < 10.0


def test_the_clock_jumps(bench):
    begun = bench()
    client = begun.rtde()
    client.outputs("timestamp")
    client.start()
    before = client.package()[0]
    begun.fault("ur.clock_jump", ms=2500)
    assert client.package()[0] - before >= 2.4


def test_another_client_has_the_inputs(bench):
    begun = bench()
    begun.fault("ur.second_client", for_ms=1000)
    client = begun.rtde()
    assert client.inputs("input_int_register_0") == (0, ["IN_USE"])
    begun.let_pass(1.0)
    assert client.inputs("input_int_register_0") == (1, ["INT32"])


def test_another_controller_s_serial_number(bench):
    begun = bench()
    own = begun.command("get serial number")
    begun.fault("ur.wrong_serial", for_ms=500)
    assert begun.command("get serial number") != own
    begun.let_pass(0.6)
    assert begun.command("get serial number") == own


def test_local_control_refuses_programs_and_commands(bench):
    begun = bench()
    begun.fault("ur.local", for_ms=20_000)
    assert begun.command("is in remote control") == "false"
    client = begun.call(PRIMARY)
    client.sendall(b"set_digital_out(1, True)\n")
    begun.let_pass(0.1)
    assert begun.board.digital_out == 0
    begun.let_pass(20.0)
    assert begun.command("is in remote control") == "true"


def test_slow_bytes_are_whole_packages_in_the_end(bench):
    begun = bench()
    client = begun.rtde()
    client.outputs("timestamp", "actual_q")
    client.start()
    begun.fault("ur.slow", bytes=3, for_ms=2000)
    times = [client.package()[0] for _ in range(5)]
    assert min(b - a for a, b in pairwise(times[1:])) > 0.01


def test_whoever_acknowledges_at_the_pendant_ends_a_stop(bench):
    begun = moving(bench(errors={}))
    begun.fault("ur.protective_stop")
    begun.settle()
    begun.controller.requests["acknowledge"]({})
    assert begun.controller.ready
    begun.scene.safety.open_guard()
    with pytest.raises(Exception, match="safety chain is open"):
        begun.controller.requests["acknowledge"]({})


def test_a_program_is_refused_while_the_arm_is_off(bench):
    begun = bench(power="off")
    assert begun.run("movej([0, 0, 0, 0, 0, 0])", seconds=0.1) == ["0: the robot is not ready: no program is started"]


def test_the_same_seed_gives_the_same_bytes(bench):
    def session():
        begun = bench()
        client = begun.rtde()
        client.outputs("timestamp", "actual_q", "actual_current", "actual_TCP_pose")
        client.start()
        begun.run(FAR, seconds=0.2)
        return begun.received(client.client, 3000)

    assert session() == session()


def test_the_host_s_bytes_on_all_ports_are_counted_together(bench):
    begun = bench()
    begun.command("running")
    client = begun.call(RTDE)
    client.sendall(b"\x00\x03v")
    assert len(begun.received(client, 19)) == 19
    assert begun.wire.has_read(len("running\n") + 3)
    assert not begun.wire.has_read(len("running\n") + 4)
    other = begun.call(RTDE)
    other.sendall(b"\x00\x03v")
    begun.received(other, 19)
    assert not begun.wire.has_read(len("running\n") + 4)
