"""`cellctl cell`: cell files for robots of the library pass the checks; a robot without a driver is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cellctl.cli.verbs import app
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, load_yaml
from cellctl.robot_file import RobotFile


def made(out: Path, robot: str, *words: str) -> dict[str, list[str]]:
    """What `cellctl cell` says of the cell that it wrote. Raises its error."""
    given = ("cell", robot, *words, "-o", str(out), "--json", "-")
    ended = CliRunner().invoke(app, given, catch_exceptions=False)
    assert ended.exit_code == 0, ended.output
    said: dict[str, list[str]] = json.loads(ended.stdout)
    return said


@pytest.mark.long
@pytest.mark.parametrize("robot", ["ur5e", "kr5_arc"])
def test_a_cell_with_a_probe_passes_the_check_of_the_campaign(robot: str, tmp_path: Path) -> None:
    said = made(tmp_path / "my_cell.yaml", robot, "--probe")
    assert said["checked"] == ["sphere_selfcal"]
    cell = Cell.load(tmp_path / "my_cell.yaml", DriverRegistry())
    assert set(cell.addresses) == {"robot", "probe"}
    assert any(RobotFile.load(cell.robot_file).tool.xyz), "without a tool the probe's tip would be the flange"
    assert "FILL IN" in (tmp_path / "my_cell.yaml").read_text()


def test_a_cell_with_a_tracker_names_the_robot_of_the_library_and_has_no_spheres(tmp_path: Path) -> None:
    said = made(tmp_path / "my_cell.yaml", "ur16e", "--tracker", "--plc")
    assert said["checked"] == ["tracker_calibration"]
    data = load_yaml(tmp_path / "my_cell.yaml").data
    assert data["model"] == "ur16e"
    assert set(data["devices"]) == {"robot", "tracker", "plc"}
    assert "artefact" not in data


def test_a_simulated_controller_has_the_program_that_the_cell_needs(tmp_path: Path) -> None:
    made(tmp_path / "my_cell.yaml", "ur10e", "--tracker", "--plc")
    programs = tmp_path / load_yaml(tmp_path / "my_cell.yaml").data["simulate"]["ur"]["programs"]
    assert "my_cell" not in (programs / "cellctl.script").read_text()
    assert "ur10e cell" in (programs / "cellctl.script").read_text()


@pytest.mark.parametrize("robot", ["irb120", "iiwa7"])
def test_a_robot_that_no_driver_moves_is_refused_with_what_can_be_done_by_files(robot: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no driver moves the") as refused:
        made(tmp_path / "my_cell.yaml", robot, "--probe")
    assert "without-kuka.md" in str(refused.value)
    assert not list(tmp_path.iterdir())


def test_a_file_that_exists_is_kept(tmp_path: Path) -> None:
    (tmp_path / "my_cell.yaml").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        made(tmp_path / "my_cell.yaml", "ur5e", "--probe")
    assert (tmp_path / "my_cell.yaml").read_text() == "mine"


def test_without_an_instrument_there_is_nothing_to_write(tmp_path: Path) -> None:
    ended = CliRunner().invoke(app, ["cell", "ur5e", "-o", str(tmp_path / "my_cell.yaml")])
    assert ended.exit_code != 0
    assert not list(tmp_path.iterdir())
