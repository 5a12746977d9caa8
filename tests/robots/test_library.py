"""The library of robots: a name stands for a file in a cell, for the simulators, and on the command line."""

from pathlib import Path

import pytest
import yaml

from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.formats import RobotFile
from cellctl.installed import robot_file, shipped
from cellctl.robot_file import SecondSource
from sims.cell import CellError, read_cell
from sims.robot_file import read_robot
from sims.section import Section


def cell(folder: Path, model: str) -> Path:
    file = folder / "cell.yaml"
    devices = "{probe: contact+serial:///dev/ttyS9}"
    file.write_text(f"name: a cell\nmodel: {model}\ndevices: {devices}\nsimulate: {{}}\n", encoding="utf-8")
    return file


def test_a_cell_names_a_robot_of_the_library(tmp_path):
    loaded = Cell.load(cell(tmp_path, "kr300_r2500"), DriverRegistry())
    assert RobotFile.load(loaded.robot_file).name == "KUKA KR300 R2500 ultra"


def test_the_simulated_cell_finds_the_same_robot_by_the_same_name(tmp_path):
    assert read_cell(cell(tmp_path, "kr300_r2500")).robot.name == "KUKA KR300 R2500 ultra"


def test_a_file_beside_the_cell_comes_before_the_library(tmp_path):
    (tmp_path / "tx60").write_text("my own")
    assert robot_file("tx60", tmp_path) == tmp_path / "tx60"


def test_an_unknown_name_in_a_cell_is_refused_with_the_nearest_names(tmp_path):
    file = cell(tmp_path, "kr300_r2700")
    with pytest.raises(InputError, match="did you mean kr300_r2500"):
        Cell.load(file, DriverRegistry())
    with pytest.raises(CellError, match="model: kr300_r2700"):
        read_cell(file)


def test_every_robot_of_the_library_states_source_licence_and_check():
    for name, file in shipped("robot").items():
        source = RobotFile.load(file).source
        assert source is not None, name
        assert source.checked == "single source" or isinstance(source.checked, SecondSource), name


def test_the_source_is_no_property_of_the_robot():
    assert "source" not in RobotFile.load(shipped("robot")["tx60"]).model_dump()


@pytest.mark.parametrize("name", shipped("robot"))
def test_the_simulators_read_every_robot_of_the_library(name):
    problems: list[str] = []
    theirs = read_robot(Section(yaml.safe_load(shipped("robot")[name].read_text(encoding="utf-8")), "", problems))
    ours = RobotFile.load(shipped("robot")[name])
    assert not problems
    assert [link.a for link in theirs.links] == [link.a for link in ours.links]


@pytest.mark.parametrize(
    ("checked", "words"), [("two sources", "single source"), ("{against: a drawing}", "agreement_mm")]
)
def test_a_check_without_its_agreement_is_refused(tmp_path, checked, words):
    text = shipped("robot")["tx60"].read_text(encoding="utf-8").replace("checked: {", f"checked: {checked}  # {{")
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=words):
        RobotFile.load(tmp_path / "robot.yaml")
