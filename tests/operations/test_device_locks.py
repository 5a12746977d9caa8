"""Two processes never use one real device: by whatever address, from whatever cell file, as whatever user."""

from __future__ import annotations

import asyncio
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from cellctl.devices import Address, DeviceBusy, Identity
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.engine import NobodyWatching, State
from cellctl.operations import run_control
from cellctl.operations.campaign import load_campaign
from cellctl.operations.cell_devices import DeviceLocks, refuse_in_use
from cellctl.operations.doctor import examine
from cellctl.operations.launch import Options, new_run
from cellctl.operations.table import TableCell
from tests.helpers.engine import FakeDevice, engine_for
from tests.helpers.runs import SELFCAL, cell_with

DRIVERS = DriverRegistry()
PLC = "modbus+tcp://127.0.0.1:9"


def real_cell(folder: Path, devices: dict[str, str]) -> Cell:
    """A cell without simulators, with these devices."""
    folder.mkdir(exist_ok=True)
    listed = "".join(f"  {name}: {address}\n" for name, address in devices.items())
    (folder / "real.yaml").write_text(f"name: real\nmodel: kr5_r1400\ndevices:\n{listed}")
    return Cell.load(folder / "real.yaml", DRIVERS)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("modbus+tcp://localhost", "modbus+tcp://127.0.0.1:502?unit=3"),
        ("modbus+tcp://[::ffff:10.0.0.5]:502", "modbus+tcp://10.0.0.5"),
        ("modbus+tcp://PLC.invalid.", "modbus+tcp://plc.invalid:502"),
        ("contact+serial:///dev/../dev/ttyACM9", "geocom+serial:///dev/ttyACM9"),
        ("kuka+rsi://0.0.0.0:49152?ethernet=a.xml&eki=10.0.0.2:54600", "kuka+varproxy://10.0.0.2"),
        ("kuka+rsi://0.0.0.0:1?ethernet=a.xml&eki=10.0.0.2:54600&controller=10.0.1.2", "kuka+varproxy://10.0.1.2:7001"),
        ("canopen+socketcan://can0?nodes=1,2&bitrate=500000", "canopen+socketcan://can0?nodes=3"),
    ],
)
def test_two_addresses_of_one_device_name_one_place(one: str, other: str) -> None:
    assert DRIVERS.places(Address.parse(one)) & DRIVERS.places(Address.parse(other))


def test_programs_on_this_computer_with_ports_of_their_own_are_different_places() -> None:
    places = [
        DRIVERS.places(Address.parse(f"kuka+{rest}"))
        for rest in ("rsi://127.0.0.1:0?ethernet=a.xml&eki=127.0.0.1:41001", "varproxy://127.0.0.1:41002")
    ]
    assert places[0]
    assert not places[0] & places[1]


def test_a_link_to_a_serial_port_is_the_same_place(tmp_path: Path) -> None:
    ends = pty.openpty()
    link = tmp_path / "by-id"
    link.symlink_to(os.ttyname(ends[1]))
    places = [
        DRIVERS.places(Address("contact+serial", "", None, path, {})) for path in (str(link), os.ttyname(ends[1]))
    ]
    for end in ends:
        os.close(end)
    assert places[0] == places[1]
    assert "terminal" in next(iter(places[0]))


def test_two_cell_files_with_one_device_exclude_each_other_for_run_doctor_and_table(tmp_path: Path) -> None:
    robot = "kuka+varproxy://127.0.0.1:9"
    first = real_cell(tmp_path / "first", {"robot": robot, "plc": PLC})
    second = real_cell(tmp_path / "second", {"arm": "kuka+varproxy://localhost:9"})
    other = real_cell(tmp_path / "other", {"plc": "modbus+tcp://127.0.0.1:10"})
    said = r"arm: is in use by run sphere-7 \(process \d+, since "
    with DeviceLocks.held(first, DRIVERS, run="sphere-7"):
        with DeviceLocks.held(other, DRIVERS):
            refuse_in_use(real_cell(tmp_path / "third", {"plc": "modbus+tcp://127.0.0.1:11"}), DRIVERS)
        with pytest.raises(DeviceBusy, match=said):
            asyncio.run(examine(second, DRIVERS))

        async def work(*_: object) -> None:
            raise AssertionError("nothing is connected")

        with pytest.raises(DeviceBusy, match=said):
            TableCell.load(second.path, None, None).carry_out(work)
        with pytest.raises(DeviceBusy, match=said):
            refuse_in_use(second, DRIVERS)
    refuse_in_use(second, DRIVERS)


def test_a_start_on_a_cell_in_use_is_refused_with_the_name_of_the_other_run_and_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started = cell_with(tmp_path)  # its robot by EthernetKRL; the other run has it by the variable proxy
    started.write_text(started.read_text().partition("\nsimulate:")[0])
    other = real_cell(tmp_path / "other", {"arm": "kuka+varproxy://172.31.1.147"})
    ended = subprocess.Popen([sys.executable, "-c", ""])
    monkeypatch.setattr(run_control, "_started", lambda *_: ended)  # the process that `carry_out` below stands for
    campaign = load_campaign(SELFCAL, started, [])
    said = "robot: is in use by run sphere-7"
    with DeviceLocks.held(other, DRIVERS, run="sphere-7"):
        with pytest.raises(DeviceBusy, match=said):
            new_run(campaign, tmp_path / "runs", Options(1, None)).carry_out(NobodyWatching())
        with pytest.raises(DeviceBusy, match=said):
            asyncio.run(run_control.start_detached(run_control.RunOrder(SELFCAL, started), tmp_path / "runs", "Ada"))
    assert list((tmp_path / "runs").iterdir()) == []


def test_a_device_reached_by_a_second_address_is_recognised_by_its_serial_number(tmp_path: Path) -> None:
    cells = [real_cell(tmp_path / str(host), {"plc": f"modbus+tcp://10.0.0.{host}"}) for host in (1, 2)]

    def plc(serial: str, *, simulated: bool = False) -> Identity:
        return Identity("plc", serial, "PLC", "1", simulated)

    with DeviceLocks.held(cells[0], DRIVERS, run="sphere-7") as first, DeviceLocks.held(cells[1], DRIVERS) as second:
        for identity in (plc("X20-1"), plc("0"), plc("SIM-1", simulated=True)):
            first.meet(identity)
        second.meet(plc("0"))
        second.meet(plc("SIM-1", simulated=True))
        second.meet(plc("X20-2"))
        with pytest.raises(DeviceBusy, match="run sphere-7"):
            second.meet(plc("X20-1"))


def test_a_device_of_another_run_is_neither_stopped_nor_cleaned_up(tmp_path: Path) -> None:
    def meet(identity: Identity) -> None:
        raise DeviceBusy(identity.device, "is in use by run sphere-7")

    robot = FakeDevice("robot")
    engine, _, journal = engine_for("  - {id: a, do: test.hold}", tmp_path, [robot], "  - {id: b, do: test.hold}")
    engine._meet = meet
    outcome = asyncio.run(engine.run())
    journal.close()
    assert (outcome.state, str(outcome.error)) == (State.FAILED, "robot: is in use by run sphere-7")
    assert robot.calls == ["connect", "close"]
