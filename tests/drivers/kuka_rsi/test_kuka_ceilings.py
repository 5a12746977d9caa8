"""No cell file can ask more of the robot than the ceilings of the lowest layer; what a search does not need is told."""

from __future__ import annotations

import asyncio
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from cellctl.cli.run import check
from cellctl.cli.run import run as run_command
from cellctl.clock import WallClock
from cellctl.devices import Address, DeviceUnreachable
from cellctl.devices.cell import Cell, reach_of
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.formats import RobotFile
from cellctl.journal import JournalError
from cellctl.planning import TouchOptions
from drivers.kuka_rsi.cyclic.limits import SEARCH_NEEDS, SearchLimits, ceilings
from drivers.kuka_rsi.robot.kuka_robot import KukaRobot
from drivers.kuka_rsi.settings import RsiSettings
from tests.helpers.runs import CELL, ROOT, SELFCAL, cell_with

LIMITS = "{correction_deg: 5, speed_deg_s: 2.5, acceleration_deg_s2: 20, jerk_deg_s3: 400, travel_deg: 5}"
CONTROLLER = "&controller=192.168.10.1"


def cell(folder: Path, replace: dict[str, str]) -> Cell:
    return Cell.load(cell_with(folder, replace=replace), DriverRegistry())


@pytest.mark.parametrize("name", ceilings(2000))
def test_limits_above_a_ceiling_cannot_be_made(name: str) -> None:
    highest = ceilings(2000)[name]
    assert getattr(SearchLimits.from_settings({name: highest}, 2000), name) == highest
    with pytest.raises(ValueError, match=f"{name}.* above the ceiling of {highest:g}"):
        SearchLimits.from_settings({name: highest * 1.01}, 2000)
    with pytest.raises(ValueError, match=f"{name}.* above the ceiling"):
        SearchLimits(**{name: highest * 1.01, "reach_mm": 2000})


@pytest.mark.parametrize("robot", ["kr5_r1400", "ur10"])
def test_at_the_ceiling_of_speed_the_tcp_moves_at_most_250_mm_a_second_in_any_posture(robot: str) -> None:
    file = ROOT / "procedures" / "robots" / f"{robot}.yaml"
    model = RobotFile.load(file)
    readings = np.random.default_rng(1).uniform(*model.limits().T, (2000, 6))
    jacobians = model.chain().tool_jacobian(model.joint_map().model(readings))[:, :3]
    fastest = np.linalg.norm(jacobians, 2, axis=(1, 2)).max()  # mm/rad, by the worst joint vector of norm 1
    speed = math.radians(ceilings(reach_of(file))["speed_deg_s"])
    assert 80 < fastest * speed <= 250


def test_an_unknown_reach_counts_as_the_longest_arm_and_a_very_short_one_as_half_a_metre() -> None:
    assert (
        ceilings(None)
        == ceilings(3900)
        == {
            "correction_deg": 5.0,
            "speed_deg_s": 2.12,
            "acceleration_deg_s2": 21.2,
            "jerk_deg_s3": 530.12,
            "travel_deg": 5.0,
        }
    )
    assert ceilings(100) == ceilings(500)


def test_the_low_defaults_of_a_very_long_arm_stay_under_its_ceilings() -> None:
    limits = SearchLimits.from_settings({}, 6000)
    assert limits.speed_deg_s == ceilings(6000)["speed_deg_s"] < 2.0
    assert SearchLimits(**asdict(limits)) == limits


def test_a_cell_file_cannot_say_a_shorter_reach() -> None:
    with pytest.raises(ValueError, match="unknown robot limit reach_mm"):
        SearchLimits.from_settings({"reach_mm": 500.0, "speed_deg_s": 10.0}, 2000)


def test_the_cyclic_process_refuses_limits_that_something_above_it_lifted() -> None:
    lifted = SearchLimits()
    object.__setattr__(lifted, "speed_deg_s", 30.0)
    address = Address.parse("kuka+rsi://127.0.0.1:0?ethernet=rsi_ethernet.xml&eki=127.0.0.1:1")
    robot = KukaRobot("robot", RsiSettings.of(address, CELL.parent), WallClock(), lifted)
    with pytest.raises(DeviceUnreachable, match="speed_deg_s: 30 is above the ceiling"):
        asyncio.run(robot.connect())


def test_check_refuses_a_limit_above_its_ceiling_at_its_line_with_the_reason_and_a_cure(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        cell(tmp_path, {LIMITS: "\n    correction_deg: 30\n    speed_deg_s: 8"})
    at = cell_with(tmp_path, replace={LIMITS: "\n    correction_deg: 30\n    speed_deg_s: 8"})
    line = at.read_text().splitlines().index("    correction_deg: 30") + 1
    assert str(refused.value) == (
        f"{at}:{line}:5: robot: robot limit correction_deg: 30 is above the ceiling of 5 (what AXISCORR allows; no "
        "search needs more)\n    give a number above 0 and up to 5\n"
        f"{at}:{line + 1}:5: robot: robot limit speed_deg_s: 8 is above the ceiling of 3.76 (250 mm/s at the TCP, with "
        "a reach of 2196 mm)\n    give a number above 0 and up to 3.76"
    )


@pytest.mark.long
def test_check_and_run_warn_of_a_limit_above_what_a_search_needs_and_go_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = cell_with(tmp_path, replace={"speed_deg_s: 2.5": "speed_deg_s: 3"})
    check(SELFCAL, file)
    said = capsys.readouterr()
    assert "no errors found" in said.out
    assert said.err.startswith(f"cellctl: 1 warning\n{file}:")
    assert "robot limit speed_deg_s: 3 is more than a search needs (2.5)\n    give 2.5 or less" in said.err
    with pytest.raises(JournalError, match="there is no journal"):  # the run goes as far as what it would go on with
        run_command(SELFCAL, file, runs=tmp_path, resume=tmp_path / "none", set_=None)
    assert "is more than a search needs" in capsys.readouterr().err


def test_a_cell_whose_telegrams_are_expected_from_the_eki_address_is_warned_of(tmp_path: Path) -> None:
    (warning,) = cell(tmp_path, {CONTROLLER: ""}).warnings
    assert "telegrams are taken from 172.31.1.147 alone" in warning.what
    assert "&controller=IP" in warning.cure
    assert cell(tmp_path, {CONTROLLER: "", "172.31.1.147": "127.0.0.1"}).warnings == ()


@pytest.mark.parametrize("name", ["sphere_cell", "single_sphere_cell"])
def test_the_shipped_cells_have_low_limits_that_every_planned_search_keeps(name: str) -> None:
    shipped = Cell.load(CELL.parent / f"{name}.yaml", DriverRegistry())
    assert shipped.warnings == ()
    limits, options = shipped.limits["robot"], TouchOptions()
    fastest_search_mm_s = 10.0  # the most that the procedures' search_speed may be set to
    assert limits["speed_deg_s"] >= fastest_search_mm_s * options.search_joints / (options.guard + options.depth)
    assert limits["travel_deg"] > options.search_joints
    assert {need: limits[need] for need in SEARCH_NEEDS} == SEARCH_NEEDS


def test_a_search_is_at_full_speed_within_a_millimetre_with_the_limits_that_it_needs() -> None:
    speed, acceleration, jerk = SEARCH_NEEDS.values()
    ramp_s = speed / acceleration + acceleration / jerk
    assert 10.0 * ramp_s / 2 < 1.0
