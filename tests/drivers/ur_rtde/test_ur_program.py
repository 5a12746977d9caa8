"""The resident program as it is written for a cell: its limits, its digest; the address and limits of the cell file."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, Surroundings
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.formats import RobotFile
from drivers.ur_rtde.description import DRIVER
from drivers.ur_rtde.settings import controller_files

CELLS = Path(__file__).parents[3] / "procedures" / "cells"


def written(address="ur+rtde://192.168.0.10?contact_input=3", cell="a cell", **limits):
    around = Surroundings(WallClock(), Path(), limits, reach_mm=1300.0)
    return controller_files(cell, Address.parse(address), around)["cellctl.script"]


def constant(script, name):
    return re.search(rf"global {name} = (\S+)", script)[1]


def digest(script):
    return re.findall(r"write_output_integer_register\(2[45], (\d+)\)", script)


def test_the_program_has_the_limits_of_the_cell_file():
    script = written(speed_percent=10, speed_deg_s=1.5, travel_deg=3)
    assert math.degrees(float(constant(script, "MOVE_SPEED"))) == pytest.approx(12.0, abs=1e-6)
    assert math.degrees(float(constant(script, "SEARCH_SPEED"))) == pytest.approx(1.5, abs=1e-6)
    assert math.degrees(float(constant(script, "TRAVEL"))) == pytest.approx(3.0, abs=1e-6)
    assert constant(script, "CONTACT_INPUT") == "3"
    assert constant(written("ur+rtde://10.0.0.1"), "CONTACT_INPUT") == "-1"
    assert "@" not in script


def test_the_digest_is_of_all_that_the_program_does_and_not_of_the_cell_s_name():
    first = digest(written())
    assert len(first) == 2
    assert digest(written(cell="another")) == first
    assert digest(written(travel_deg=3)) != first
    assert digest(written("ur+rtde://10.0.0.1?contact_input=4")) != first
    assert all(0 <= int(part) < 2**31 for part in first)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("ur+rtde://10.0.0.1?contact_input=8", "contact_input is a whole number from 0 to 7"),
        ("ur+rtde://10.0.0.1?input=1", "unknown setting input"),
        ("ur+rtde://10.0.0.1/path", "has to name a host, and no path"),
        ("ur+rtde://0.0.0.0", "is the address of no device"),
    ],
)
def test_an_address_that_cannot_be_is_refused(address, says):
    with pytest.raises(ValueError, match=says):
        written(address)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"speed_percent": 101}, "outside 0 … 100"),
        ({"speed_deg_s": 7}, "outside 0 … 6.36"),
        ({"travel_deg": 0}, "outside 0 … 10"),
        ({"jerk_deg_s3": 1}, "unknown limit 'jerk_deg_s3'"),
    ],
)
def test_a_limit_over_its_ceiling_is_refused(limits, says):
    around = Surroundings(WallClock(), Path(), limits, reach_mm=1300.0)
    (found,) = DRIVER.check_setup(Address.parse("ur+rtde://10.0.0.1?contact_input=0"), around)
    assert says in found.what


def test_a_probe_without_a_wire_to_the_controller_is_warned_of():
    (found,) = DRIVER.check_setup(Address.parse("ur+rtde://10.0.0.1"), Surroundings(WallClock(), Path()))
    assert found.warning
    assert "stops the robot by this computer alone" in found.what


def test_the_shipped_cell_s_program_is_the_one_that_is_written_for_it():
    drivers = DriverRegistry()
    cell = Cell.load(CELLS / "ur10e_cell.yaml", drivers)
    around = cell.surroundings("robot", WallClock())
    for name, text in drivers.controller_files(cell.name, cell.addresses["robot"], around).items():
        assert (CELLS / "ur10e_programs" / name).read_text() == text, "cellctl krl ur10e_cell -o …/ur10e_programs"


def test_the_shipped_cell_s_robot_is_the_checked_one_with_a_tool():
    bare, probing = (RobotFile.load(CELLS.parent / "robots" / name) for name in ("ur10e.yaml", "ur10e_probe.yaml"))
    assert (probing.links, probing.joints, probing.base) == (bare.links, bare.joints, bare.base)
