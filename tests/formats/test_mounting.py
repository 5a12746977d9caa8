"""How a robot stands, as its file says it: which way weight pulls, in every form that the robot is converted to."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.calibration import DOWN, JointCompliance, Split, ToolDeflection, fit
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.files import InputError, parse_yaml, sha256_of
from cellctl.formats import DataSet, ModelFile, RobotFile, from_prior, measurements, nominal_model
from cellctl.formats.description import RobotDescription, robot_text
from cellctl.formats.urdf import load_urdf, urdf_text
from sims.robot_file import read_robot
from sims.section import Section

FILE = Path(__file__).parents[2] / "procedures" / "robots" / "kr5_r1400.yaml"
KR5 = RobotFile.load(FILE)
LEVEL = np.array([0.0, -90.0, 90.0, 0.0, 0.0, 0.0])
TILT = {"tilt": [170.0, 30.0, -20.0]}


def mounted(mounting="floor", abc=(0.0, 0.0, 0.0), robot=KR5):
    base = {"xyz": [100.0, -50.0, 700.0], "abc": list(abc)}
    return RobotFile.model_validate({**robot.model_dump(), "mounting": mounting, "base": base})


def bent(robot, readings=LEVEL):
    """Where weight takes the tip (3,), mm, in the frame that the file's base is given in."""
    stiff, soft = nominal_model(robot), nominal_model(robot, touched=True)
    soft = soft.with_deviations([0.002 * (name == "tool_deflection") for name in soft.names])
    q = robot.joint_map().model(readings[None])
    return (soft.tcp(q) - stiff.tcp(q))[0]


@pytest.mark.parametrize(
    ("mounting", "down"),
    [("floor", [0, 0, -1]), ("wall", [1, 0, 0]), ("ceiling", [0, 0, 1]), ({"tilt": [77.0, 0.0, 90.0]}, [0, -1, 0])],
)
def test_each_mounting_has_its_direction_of_weight(mounting, down):
    assert mounted(mounting).down() == tuple(down)
    assert mounted(mounting, abc=[25.0, 0.0, 0.0]).down() == pytest.approx(
        Rotation.from_euler("z", -25.0, degrees=True).apply(down)
    )


def test_a_base_that_leans_in_its_file_leans_against_gravity():
    """The base is where the robot stands in the world, so that a robot stands alike however its file shares it out."""
    assert mounted(abc=[0.0, 90.0, 0.0]).down() == mounted("wall").down()
    assert mounted("wall", abc=[0.0, -90.0, 0.0]).down() == DOWN
    tilted = mounted(abc=TILT["tilt"])
    assert tilted.down() == pytest.approx(mounted(TILT).down())
    turn = Rotation.from_euler("ZYX", TILT["tilt"], degrees=True)
    np.testing.assert_allclose(bent(tilted), turn.apply(bent(mounted(TILT))), atol=1e-12)


def test_a_robot_says_nothing_of_a_mounting_that_its_file_does_not_have():
    assert "mounting" not in KR5.model_dump()
    plain = {name: value for name, value in KR5.model_dump().items() if name != "mounting"}
    assert sha256_of(RobotFile.model_validate({**plain, "mounting": "floor"}).model_dump()) == sha256_of(plain)
    assert mounted("wall").model_dump()["mounting"] == "wall"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("upside", "'floor', 'wall' or 'ceiling'"),
        ("90", "'floor', 'wall' or 'ceiling'"),
        ("{tilt: [0, 90]}", "mounting.tilt"),
        ("{tilt: [0, 90, 400]}", "mounting.tilt.2"),
        ("{lean: 5}", "'lean'"),
    ],
)
def test_a_mounting_that_is_none_is_named_where_it_stands(text, words):
    file = f"{FILE.read_text()}mounting: {text}\n"
    with pytest.raises(InputError) as caught:
        RobotFile.from_document(parse_yaml(file, "robot.yaml"))
    assert {problem.line for problem in caught.value.problems} == {file.count("\n")}
    assert any(words in problem.what for problem in caught.value.problems)


@pytest.mark.parametrize("form", ["mdh-hayati", "dh-craig", "poe"])
@pytest.mark.parametrize("mounting", ["floor", "wall", TILT])
def test_weight_bends_a_robot_the_same_way_in_whatever_convention_its_file_is(form, mounting):
    robot = mounted(mounting, abc=[40.0, 15.0, -170.0])
    text = robot_text(RobotDescription.of(robot), form, "there")
    there = RobotFile.from_document(parse_yaml(text, "there.yaml"))
    assert there.mounting == robot.mounting
    np.testing.assert_allclose(bent(there), bent(robot), atol=1e-9)


def test_a_robot_read_from_its_urdf_has_its_weight_pulling_downwards(tmp_path):
    """Its first axis points down, so that the table's base stands on its head, and weight pulls along its +z."""
    (tmp_path / "kr5.urdf").write_text(urdf_text(RobotDescription.of(KR5)))
    found = replace(load_urdf(tmp_path / "kr5.urdf"), repeatability=0.03, tool_mass=KR5.tool.mass)
    robot = RobotFile.from_document(parse_yaml(robot_text(found, "mdh-hayati", "kr5"), "kr5.yaml"))
    assert robot.base.abc == [0.0, 0.0, 180.0]
    assert bent(robot)[2] < 0.0
    np.testing.assert_allclose(bent(robot), bent(KR5), atol=1e-9)


@pytest.mark.parametrize(("form", "said"), [("urdf", True), ("dh-csv", True), ("poe", False)])
def test_a_mounting_that_a_form_has_no_place_for_is_named(form, said, tmp_path, capsys):
    (tmp_path / "wall.yaml").write_text(f"{FILE.read_text()}mounting: wall\n")
    words = ["convert", str(tmp_path / "wall.yaml"), "--to", form]
    assert exit_codes.exit_code_of(lambda: app(words, standalone_mode=False)) == 0
    assert ("left out, as this form has no place for it: mounting" in capsys.readouterr().err) == said


def fitted(robot, count=60):
    """A model with all that weight bends, made on this robot."""
    q = np.random.default_rng(1).uniform(-0.6, 0.6, (count, 6)) + robot.joint_map().model(LEVEL[None])
    model = nominal_model(robot, touched=True)
    names = [*(f"A{joint}" for joint in range(1, 7)), "X", "Y", "Z"]
    rows = np.column_stack([robot.joint_map().readings(q), model.tcp(q)]).tolist()
    data = DataSet.of_records(dict(zip(names, row, strict=True)) for row in rows)
    measured = measurements(robot, data, model="deflection+compliance")
    return measured, ModelFile.of(robot, measured, fit(measured.task, Split(np.arange(count), ())))


def test_a_model_file_knows_which_way_weight_pulled_and_one_that_does_not_say_stood_upright(tmp_path):
    _, model = fitted(mounted("wall"))
    model.save(tmp_path / "model.json")
    effects = ModelFile.load(tmp_path / "model.json").robot_model().effects
    assert {type(effect): effect.down for effect in effects} == {
        ToolDeflection: (1.0, 0.0, 0.0),
        JointCompliance: (1.0, 0.0, 0.0),
    }
    content = json.loads((tmp_path / "model.json").read_text())
    for effect in content["effects"]:
        del effect["down"]
    (tmp_path / "older.json").write_text(json.dumps(content))
    assert {effect.down for effect in ModelFile.load(tmp_path / "older.json").robot_model().effects} == {DOWN}


def test_a_prior_model_of_a_robot_that_stood_otherwise_is_refused_and_one_turned_upright_is_not():
    measured, model = fitted(KR5)
    for robot in (mounted("wall"), mounted(abc=[0.0, 3.0, 0.0])):
        with pytest.raises(InputError, match="stood otherwise than"):
            from_prior(replace(measured, robot=robot), model)
    turned = mounted(abc=[60.0, 0.0, 0.0])
    assert from_prior(replace(measured, robot=turned), model).task.prior is not None


@pytest.mark.parametrize("mounting", ["floor", "wall", "ceiling", TILT])
def test_the_simulator_has_the_same_weight_pulling_by_its_own_reading_of_the_file(mounting):
    robot, problems = mounted(mounting, abc=[10.0, -35.0, 60.0]), []
    simulated = read_robot(Section(robot.model_dump(), "", problems))
    turn = Rotation.from_euler("ZYX", robot.base.abc, degrees=True)
    assert problems == []
    np.testing.assert_allclose(simulated.down, turn.apply(robot.down()), atol=1e-12)


@pytest.mark.parametrize("mounting", ["upside", 90, {"tilt": [1, 2]}, {"lean": 5}])
def test_the_simulator_names_a_mounting_that_is_none(mounting):
    problems = []
    read_robot(Section({**KR5.model_dump(), "mounting": mounting}, "robot", problems))
    assert any("mounting" in problem for problem in problems)
