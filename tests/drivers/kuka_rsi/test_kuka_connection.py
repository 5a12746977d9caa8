"""Connecting to, moving and leaving a KUKA controller."""

from __future__ import annotations

import asyncio
import gc
import os
import select
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices import (
    Address,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    DeviceUnreachable,
    LimitExceeded,
    Listener,
    SearchingRobot,
    Surroundings,
)
from drivers.kuka_rsi.description import open_robot
from drivers.kuka_rsi.robot import rsi_process

TARGET = (10.0, -80.0, 90.0, 0.0, 45.0, 0.0)


@pytest.fixture
def robot_at(tmp_path, ethernet_xml):
    """A robot that is not connected, at any address."""

    def make(eki_port: int, port: int = 0, xml: str = ethernet_xml):
        (tmp_path / "rsi.xml").write_text(xml)
        address = Address.parse(f"kuka+rsi://127.0.0.1:{port}?ethernet=rsi.xml&eki=127.0.0.1:{eki_port}")
        return open_robot("robot", address, Surroundings(WallClock(), tmp_path))

    return make


def test_it_is_a_searching_robot_that_listens(robot_at):
    robot = robot_at(1)
    assert isinstance(robot, SearchingRobot)
    assert isinstance(robot, Listener)
    assert robot.axes == 6


def test_identity_comes_from_hello_and_a_simulated_serial_is_seen(connected, run):
    async def connect():
        async with connected() as robot:
            return await robot.connect()

    identity = run(connect())
    assert (identity.serial, identity.model, identity.firmware) == ("SIM-000007", "KR5 R1400", "KSS 8.3.17")
    assert identity.simulated


def test_a_taken_port_is_named_with_the_cure(robot_at, run):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        xml = f"<PORT>{port}</PORT>".join(robot_xml().split("<PORT>49152</PORT>"))
        with pytest.raises(DeviceUnreachable, match=f"port {port} on 127.0.0.1 is taken") as error:
            run(robot_at(1, port, xml).connect())
    assert "ss -lunp" in error.value.cure


def robot_xml() -> str:
    here = Path(__file__).resolve().parents[3]
    return (here / "procedures/cells/rsi_ethernet.xml").read_text()


def test_a_host_that_is_not_ours_cannot_be_bound(tmp_path, ethernet_xml, run):
    (tmp_path / "rsi.xml").write_text(ethernet_xml)
    address = Address.parse("kuka+rsi://192.0.2.1:0?ethernet=rsi.xml&eki=127.0.0.1:1")
    with pytest.raises(DeviceUnreachable, match=r"cannot bind 192\.0\.2\.1"):
        run(open_robot("robot", address, Surroundings(WallClock(), tmp_path)).connect())


def test_a_controller_that_does_not_listen_is_named_and_no_process_is_left(robot_at, run):
    with socket.create_server(("127.0.0.1", 0)) as ear:
        port = ear.getsockname()[1]
    before = children()
    with pytest.raises(DeviceUnreachable, match=f"127.0.0.1:{port}"):
        run(robot_at(port).connect())
    assert children() == before


def test_an_rsi_process_that_says_nothing_is_unreachable_and_ended(robot_at, run, monkeypatch, tmp_path):
    silent = tmp_path / "silent"
    silent.write_text("#!/bin/sh\nexec sleep 600\n")
    silent.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(silent))
    monkeypatch.setattr(rsi_process, "_START_S", 0.1)
    before = children()
    with pytest.raises(DeviceUnreachable, match=r"RSI process did not start within 0\.1 s"):
        run(robot_at(1).connect())
    assert children() == before


def children() -> set[str]:
    return set(Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def test_errors_in_the_configuration_refuse_the_connection_with_file_and_line(robot_at, ethernet_xml, run):
    xml = ethernet_xml.replace("DEF_AIPos", "DEF_ASPos").replace('TAG="Stop"', 'TAG="Halt"')
    with pytest.raises(DeviceRefused, match=r"rsi\.xml:8: SEND lacks DEF_AIPos.*rsi\.xml:13: RECEIVE lacks Stop"):
        run(robot_at(1, xml=xml).connect())


def test_a_standing_message_refuses_the_connection_with_the_message(controller, connected, run):
    controller.program, controller.standing_message = "ERROR", "KSS00404 Stop by safety"

    async def connect():
        async with connected():
            pass

    with pytest.raises(DeviceFault, match="KSS00404") as fault:
        run(connect())
    assert "pendant" in fault.value.cure


def test_connect_and_close_twice_and_stop_any_time_do_no_harm(controller, connected, run):
    async def twice():
        async with connected() as robot:
            first = await robot.connect()
            assert await robot.connect() == first
            pid = robot._lines.process.pid
            await robot.stop()
            await robot.close()
            await robot.close()
            await robot.stop()
            robot.stop_now()
            robot.guard("probe").beat(5)
            with pytest.raises(DeviceLost):
                robot.listening()
            await robot.connect()
            controller.sends_to(robot.listening()[1])
            await robot.search(TARGET_NEAR, 2.0)
            return pid

    pid = run(twice())
    assert not Path(f"/proc/{pid}").exists()
    assert controller.commands.count("HALT") == 0


TARGET_NEAR = (0.0, -89.5, 90.0, 0.0, 45.0, 0.0)


def test_a_move_returns_where_it_arrived(controller, connected, run):
    async def move():
        async with connected() as robot:
            return await robot.move(TARGET, 25.0), await robot.joints()

    arrived, joints = run(move())
    assert arrived == joints == TARGET
    assert controller.commands == ["HELLO", "PTP", "HELLO"]


@pytest.mark.parametrize("speed", [0.0, -1.0, 100.1, float("nan")])
def test_a_speed_outside_its_range_is_not_sent(controller, connected, run, speed):
    async def move():
        async with connected() as robot:
            with pytest.raises(LimitExceeded):
                await robot.move(TARGET, speed)

    run(move())
    assert "PTP" not in controller.commands


def test_a_target_outside_an_axis_limit_is_reported_and_no_halt_is_needed(controller, connected, run):
    async def move():
        async with connected() as robot:
            with pytest.raises(LimitExceeded, match="axis limit"):
                await robot.move((171.0, *TARGET[1:]), 10)

    run(move())
    assert "HALT" not in controller.commands


def test_cancelling_a_move_halts_even_when_cancelled_again(controller, connected, run):
    controller.move_takes_s = 1000.0

    async def move():
        async with connected() as robot:
            task = asyncio.create_task(robot.move(TARGET, 10))
            while "PTP" not in controller.commands:
                await asyncio.sleep(0.001)
            task.cancel()
            await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert controller.halts_ended == 1

    run(move())
    assert controller.commands[-1] == "HALT"


def test_a_move_that_does_not_end_is_halted(controller, connected, run):
    controller.move_takes_s = 1000.0

    async def move():
        async with connected() as robot:
            with pytest.raises(DeviceLost, match="did not end"):
                await robot.move(TARGET, 50)

    run(move())
    assert controller.commands[-1] == "HALT"


def test_one_command_at_a_time(controller, connected, run):
    async def move():
        async with connected() as robot:
            task = asyncio.create_task(robot.move(TARGET, 10))
            await asyncio.sleep(0)
            with pytest.raises(DeviceRefused, match="another command"):
                await robot.move(TARGET, 10)
            return await task

    assert run(move()) == TARGET


def test_a_controller_that_falls_silent_is_lost(controller, connected, run):
    async def wait():
        async with connected() as robot:
            controller.eki_silent = True
            with pytest.raises(DeviceUncertain, match=r"may still be moving .*nothing heard"):
                await robot.move(TARGET, 10)
            with pytest.raises(DeviceLost):
                await robot.health()

    run(wait())


def test_a_robot_whose_standstill_is_not_confirmed_is_not_called_held(controller, connected, run):
    async def lose_it_in_a_move():
        async with connected() as robot:
            controller.eki_silent = True
            with pytest.raises(DeviceUncertain, match="may still be moving"):
                await robot.move(TARGET, 10)
            with pytest.raises(DeviceUncertain, match="may still be moving"):
                await robot.stop()
            await robot.close()  # never raises

    run(lose_it_in_a_move())


def test_a_move_that_the_controller_stops_is_a_fault(controller, connected, run):
    controller.move_takes_s = 1000.0

    async def move():
        async with connected() as robot:
            task = asyncio.create_task(robot.move(TARGET, 10))
            while "PTP" not in controller.commands:
                await asyncio.sleep(0.001)
            await robot.stop()
            with pytest.raises(DeviceFault, match="HALT"):
                await task

    run(move())


def test_health_is_well_and_says_how_rsi_runs(connected, run):
    async def look():
        async with connected() as robot:
            return await robot.health()

    health = run(look())
    assert health.ok
    assert "EXT, READY" in health.text
    assert health.figures["real_time"] in (0.0, 1.0)
    assert ("priority" in health.text) == (health.figures["real_time"] == 0.0)
    assert ("not locked" in health.text) == (health.figures["memory_locked"] == 0.0)
    assert ("no processor of its own" in health.text) == (health.figures["pinned"] == 0.0)


def test_a_killed_rsi_process_is_noticed_and_the_robot_halted(controller, connected, run):
    async def search():
        async with connected() as robot:
            pid = robot._lines.process.pid
            controller.on_cycle = lambda cycle: kill(pid) if cycle == 40 else None
            with pytest.raises(DeviceLost, match="RSI process ended"):
                await robot.search((0.0, -88.0, 90.0, 0.0, 45.0, 0.0), 2.0)
            with pytest.raises(DeviceLost, match="RSI process ended"):
                await robot.health()

    run(search())
    assert controller.commands[-1] == "HALT"


def test_an_rsi_process_killed_during_a_move_of_the_controller_ends_it_and_every_later_command(
    controller, connected, run
):
    controller.move_takes_s = 1000.0

    async def move():
        async with connected() as robot:
            task = asyncio.create_task(robot.move(TARGET, 10))
            while "PTP" not in controller.commands:
                await asyncio.sleep(0.001)
            kill(robot._lines.process.pid)
            with pytest.raises(DeviceLost, match="RSI process ended"):
                await task
            assert controller.commands[-1] == "HALT"
            robot.clear_stop()
            for command in (robot.move(TARGET, 10), robot.joints(), robot.reset(), robot.read_table()):
                with pytest.raises(DeviceLost, match="RSI process ended"):
                    await command
            await robot.stop()

    run(move())


def kill(child: int) -> None:
    """The hard way, and wait until it is gone."""
    os.kill(child, signal.SIGKILL)
    with suppress(ChildProcessError):  # somebody else has waited for it
        os.waitid(os.P_PID, child, os.WEXITED | os.WNOWAIT)


PARENT = """
import asyncio, sys
from pathlib import Path
from cellctl.clock import WallClock
from drivers.kuka_rsi.cyclic.limits import SearchLimits
from drivers.kuka_rsi.robot.rsi_process import CyclicProcess
from drivers.kuka_rsi.settings import RsiSettings

async def main():
    settings = RsiSettings(("127.0.0.1", 0), Path("rsi.xml"), ("127.0.0.1", 1))
    process = await CyclicProcess.start("robot", settings, WallClock().source, "<Sen/>", SearchLimits())
    print(process.pid, flush=True)
    await asyncio.sleep(60)

asyncio.run(main())
"""


def test_the_rsi_process_dies_with_its_parent_killed_the_hard_way():
    parent = subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE, text=True)
    with parent:
        child = int(parent.stdout.readline())
        watch = os.pidfd_open(child)
        parent.kill()
        assert gone_within(watch, 60)


def gone_within(pidfd: int, seconds: float) -> bool:
    """A pidfd becomes readable when its process ends."""
    ready, _, _ = select.select([pidfd], [], [], seconds)
    os.close(pidfd)
    return bool(ready)


def test_shared_memory_has_no_name_and_is_gone_after_close(connected, run):
    async def look():
        before = set(Path("/dev/shm").iterdir())
        async with connected():
            assert set(Path("/dev/shm").iterdir()) <= before
            assert "kuka-rsi" in mapped()

    run(look())
    gc.collect()
    assert "kuka-rsi" not in mapped()


def mapped() -> str:
    return Path("/proc/self/maps").read_text()


@pytest.mark.realtime
def test_ctrl_c_in_the_terminal_leaves_the_rsi_process_to_its_parent(connected, run):
    async def interrupt():
        async with connected() as robot:
            os.kill(robot._lines.process.pid, signal.SIGINT)
            await robot.search(TARGET_NEAR, 2.0)
            return await robot.health()

    assert run(interrupt()).ok
