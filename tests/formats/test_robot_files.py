"""Robot and artefact files: the shipped ones load, every error is named where it stands."""

from pathlib import Path

import numpy as np
import pytest

from cellctl.files import InputError
from cellctl.formats import RobotFile, load_artefact

PROCEDURES = Path(__file__).parents[2] / "procedures"

GOOD = """\
name: two joints
convention: mdh-hayati
links:
  - {theta: 0, d: 100, a: 50, alpha: 90}
  - {theta: 0, d: 0, a: 300, alpha: 0}
joints:
  - {sign: -1, offset: 10, min: -90, max: 90, max_speed: 100}
  - {min: -90, max: 90, max_speed: 100}
tool: {xyz: [0, 0, 50], abc: [0, 0, 0], mass: 1}
repeatability: 0.05
"""


def load(tmp_path, text):
    (tmp_path / "robot.yaml").write_text(text)
    return RobotFile.load(tmp_path / "robot.yaml")


def errors(tmp_path, text):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    return [(p.line, f"{p.what} {p.cure}") for p in caught.value.problems]


@pytest.mark.parametrize("robot", sorted((PROCEDURES / "robots").glob("*.yaml")), ids=lambda path: path.stem)
def test_every_shipped_robot_loads(robot):
    loaded = RobotFile.load(robot)
    assert loaded.chain().n == loaded.joint_map().n == len(loaded.limits())


def test_the_ur10_reaches_where_its_maker_says():
    flange = RobotFile.load(PROCEDURES / "robots" / "ur10.yaml").chain().forward_flange(np.zeros(6))
    np.testing.assert_allclose(flange[:3, 3], [-1184.3, -256.141, 11.6], atol=1e-6)


def test_the_iiwa_stands_upright_at_zero_and_bends_its_elbow_backwards():
    chain = RobotFile.load(PROCEDURES / "robots" / "iiwa14.yaml").chain()
    upright = chain.forward_flange(np.zeros(7))
    np.testing.assert_allclose(upright[:3], np.column_stack([np.eye(3), [0, 0, 360 + 420 + 400 + 126]]), atol=1e-9)
    elbow = chain.forward_flange(np.deg2rad([0, 0, 0, 90, 0, 0, 0]))
    np.testing.assert_allclose(elbow[:3, 3], [-526, 0, 780], atol=1e-9)


def test_a_reading_reaches_the_model_through_sign_and_offset(tmp_path):
    np.testing.assert_allclose(np.rad2deg(load(tmp_path, GOOD).joint_map().model([30.0, 5.0])), [-20.0, 5.0])


def test_all_errors_come_at_once_each_with_its_line(tmp_path):
    text = (
        GOOD.replace("a: 50,", "a: fifty,").replace("repeatability: 0.05", "repeatability: -1").replace("tool:", "tol:")
    )
    assert [line for line, _ in errors(tmp_path, text)] == [4, 9, 10]


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("alpha: 90", "alpha: 1.5708", 4, "radians"),
        ("alpha: 90}", "alpha: 0}", 4, "beta"),
        ("min: -90, max: 90, max_speed: 100}\ntool", "min: 90, max: -90, max_speed: 100}\ntool", 8, "min"),
        ("sign: -1", "sign: 2", 7, "1"),
        ("d: 100", "d: .nan", 4, "finite"),
        ("links:", "home: {xyz: [0, 0, 1]}\nlinks:", 3, "'home' does not go with mdh-hayati"),
        ("repeatability: 0.05", "repeatability: 0.05\ntolerances: {link_mm: 0}", 11, "above 0"),
        ("repeatability: 0.05", "repeatability: 0.05\ntolerances: {link_m: 1}", 11, "link_mm"),
        ("mdh-hayati", "dh", 2, "dh-craig"),
        ("mass: 1", "mass: -1", 9, "at least 0"),
        ("xyz: [0, 0, 50]", "xyz: [0, 0]", 9, "3"),
    ],
)
def test_what_no_robot_can_be_is_refused_where_it_stands(tmp_path, old, new, line, words):
    assert old in GOOD
    found = errors(tmp_path, GOOD.replace(old, new, 1))
    assert found[0][0] == line
    assert words in found[0][1]


POE = """\
name: two joints by their axes
convention: poe
screws:
  - {axis: [0, 0, 2], point: [0, 0, 0]}
  - {axis: [0, 1, 0], point: [50, 0, 100]}
home: {xyz: [350, 0, 100], abc: [0, 90, 0]}
joints:
  - {min: -90, max: 90, max_speed: 100}
  - {sign: -1, offset: 30, min: -90, max: 90, max_speed: 100}
base: {xyz: [0, 0, 1000], abc: [0, 0, 0]}
repeatability: 0.05
tolerances: {link_mm: 0.4, angle_deg: 0.03}
"""


def test_a_robot_by_its_axes_has_its_flange_at_home_at_model_zero_and_turns_about_them(tmp_path):
    robot = load(tmp_path, POE)
    assert (robot.n, len(robot.limits()), robot.chain().convention) == (2, 2, "poe")
    at_home = robot.chain().forward(robot.joint_map().model([0.0, 30.0]))
    np.testing.assert_allclose(at_home[:3, 3], [350, 0, 1100], atol=1e-9)
    np.testing.assert_allclose(at_home[:3, 2], [1, 0, 0], atol=1e-12)
    left_and_down = robot.chain().forward(robot.joint_map().model([90.0, -60.0]))
    np.testing.assert_allclose(left_and_down[:3, 3], [0, 50, 800], atol=1e-9)


def test_tolerances_are_there_where_the_file_has_them(tmp_path):
    stated = load(tmp_path, POE).tolerances
    assert (stated.link_mm, stated.angle_deg, stated.tool_mm) == (0.4, 0.03, None)
    assert load(tmp_path, GOOD).tolerances is None


def test_a_robots_content_is_what_its_file_says_and_is_read_back_from_it(tmp_path):
    for text in (GOOD, POE):
        robot = load(tmp_path, text)
        content = robot.model_dump()
        assert ("links" in content, "screws" in content) == ("links:" in text, "screws:" in text)
        assert RobotFile.model_validate(content) == robot


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("[0, 0, 2]", "[0, 0, 0]", 4, "no direction"),
        ("[0, 0, 2]", "[0, 2]", 4, "3 items"),
        ("[0, 0, 2]", "[0, .nan, 2]", 4, "finite"),
        (", point: [50, 0, 100]", "", 5, "point"),
        ("home: {xyz: [350, 0, 100], abc: [0, 90, 0]}\n", "", 1, "'home' is missing"),
        ("home:", "links: []\nhome:", 6, "'links' does not go with poe"),
        ("  - {min: -90, max: 90, max_speed: 100}\n", "", 7, "1 joints for 2 screws"),
        ("poe", "dh-craig", 1, "'links' is missing"),
        ("0.4,", "0.4, angle_rad: 1,", 12, "angle_deg"),
    ],
)
def test_what_no_robot_by_its_axes_can_be_is_refused_where_it_stands(tmp_path, old, new, line, words):
    assert old in POE
    found = errors(tmp_path, POE.replace(old, new, 1))
    assert found[0][0] == line
    assert words in found[0][1]


def test_a_joint_too_few_is_refused(tmp_path):
    text = GOOD.replace("  - {min: -90, max: 90, max_speed: 100}\n", "")
    assert "1 joints for 2 links" in errors(tmp_path, text)[0][1]


def test_a_cell_file_serves_as_artefact():
    artefact = load_artefact(PROCEDURES / "cells" / "sphere_cell.yaml")
    assert artefact.sphere("S2").diameter == 61.4
    assert artefact.tip_radius == 0.6
    assert len(artefact.distances) == 3


ARTEFACT = """\
tip_radius: 0.6
spheres:
  - {id: S1, diameter: 61.4, centre: [950, -350, 250]}
  - {id: S2, diameter: 61.4, centre: [950, 350, 250]}
distances:
  - {between: [S1, S2], mm: 700.412, sigma: 0.01}
"""


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("[S1, S2]", "[S1, S9]", 6, "S9"),
        ("[S1, S2]", "[S1, S1]", 6, "different"),
        ("id: S2", "id: S1", 3, "twice"),
        ("mm: 700.412", "mm: 0.700412", 6, "apart"),
        ("diameter: 61.4", "diameter: 0", 3, "above 0"),
    ],
)
def test_an_artefact_that_contradicts_itself_is_refused(tmp_path, old, new, line, words):
    (tmp_path / "artefact.yaml").write_text(ARTEFACT.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_artefact(tmp_path / "artefact.yaml")
    assert caught.value.problems[0].line == line
    assert words in str(caught.value)


@pytest.mark.parametrize("text", ["", "- 1\n", "artefact: 3\n"])
def test_a_file_that_is_no_artefact_is_refused(tmp_path, text):
    (tmp_path / "artefact.yaml").write_text(text)
    with pytest.raises(InputError):
        load_artefact(tmp_path / "artefact.yaml")
