"""`cellctl robots`: the list, one robot, its file; a fit takes a robot of the library by its name."""

import json

import pytest
from typer.testing import CliRunner

from cellctl.cli.verbs import app
from cellctl.files import InputError
from cellctl.formats import RobotFile
from cellctl.installed import shipped
from cellctl.operations.robot_library import markdown, reach_mm, robots
from tests.helpers.runs import ROOT


def cellctl(*words):
    """What a call prints. Raises its error."""
    return CliRunner().invoke(app, words, catch_exceptions=False).stdout


def test_the_list_has_at_least_twenty_five_robots_with_licence_and_reach():
    listed = json.loads(cellctl("robots", "--json", "-"))["robots"]
    assert len(listed) == len(shipped("robot")) >= 25
    assert all(row["licence"] and row["numbers"] and row["reach_mm"] > 400 for row in listed)


def test_one_robot_is_shown_with_its_link_table_and_written(tmp_path):
    shown = cellctl("robots", "kr300_r2500", "-o", str(tmp_path / "mine.yaml"))
    assert "1150" in shown
    assert "robotkinematicscatalogue" in shown
    assert (tmp_path / "mine.yaml").read_text() == shipped("robot")["kr300_r2500"].read_text()


def test_an_unknown_robot_is_refused_with_the_nearest_names():
    with pytest.raises(InputError, match="did you mean irb1600_6_12"):
        cellctl("robots", "irb1600")


def test_a_robot_by_its_name_converts_to_urdf():
    assert '<robot name="Stäubli TX60"' in cellctl("convert", "tx60", "--to", "urdf")


@pytest.mark.parametrize(("name", "wrist_mm", "flange_mm"), [("kr300_r2500", 2496, 240), ("kr16_2", 1611, 158)])
def test_the_reach_is_the_makers_to_the_wrist_and_the_flange_beyond(name, wrist_mm, flange_mm):
    assert reach_mm(RobotFile.load(shipped("robot")[name])) == pytest.approx(wrist_mm + flange_mm, abs=1.0)


def test_the_reference_page_has_the_table_of_the_files():
    page = (ROOT / "docs" / "reference" / "robots.md").read_text(encoding="utf-8")
    assert markdown(robots()) in page, "write the output of `cellctl robots --markdown` into docs/reference/robots.md"
