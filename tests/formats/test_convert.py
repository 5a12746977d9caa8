"""One robot through every form and back: the same tool at the same readings, by the tests' own kinematics."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.description import JointSaid, RobotDescription, robot_text
from cellctl.formats.dh_table import dh_table_text, load_dh_table
from cellctl.formats.model import JointRegion, Parameter
from cellctl.formats.urdf import load_urdf, urdf_text
from cellctl.kinematics import JointAxis, SerialChain, pose_from_xyz_abc
from tests.helpers.own_model import assert_same_pose, forward_of_dh_table, forward_of_robot_file, forward_of_urdf

ROBOTS = Path(__file__).parents[2] / "procedures" / "robots"
FORMS = {"mdh-hayati": "yaml", "dh-craig": "yaml", "poe": "yaml", "urdf": "urdf", "dh-csv": "csv"}

CROOKED = """\
name: "crooked & <odd>"
convention: dh-craig
links:
  - {theta: 12, d: 310, a: 35, alpha: 4}
  - {theta: -80, d: 12, a: 120, alpha: 91}
  - {theta: 5, d: 7, a: 410, alpha: 0.4, beta: 0.3}
  - {theta: 0.2, d: 300, a: 2, alpha: 88}
joints:
  - {sign: -1, offset: 15, min: -170, max: 160, max_speed: 90}
  - {sign: 1, offset: -90, min: -100, max: 95.5, max_speed: 80}
  - {sign: -1, offset: 180, min: -120, max: 120, max_speed: 100}
  - {sign: 1, offset: 0.25, min: -350, max: 350, max_speed: 300}
base: {xyz: [1000, -20, 7], abc: [30, 90, -12]}
tool: {xyz: [10, 20, 150], abc: [5, -90, 60], mass: 2.5}
repeatability: 0.04
tolerances: {link_mm: 0.3, tool_deg: 1}
"""


def convert(capsys, *words):
    code = exit_codes.exit_code_of(lambda: app(["convert", *map(str, words)], standalone_mode=False))
    said = capsys.readouterr()
    return code, said.out, said.err


def forward(text, form, readings, tip="tcp"):
    if form == "urdf":
        return forward_of_urdf(text, tip if f'"{tip}"' in text else "tool0", np.deg2rad(readings))
    return (forward_of_dh_table if form == "dh-csv" else forward_of_robot_file)(text, readings)


def readings_of(robot, rng):
    limits = robot.limits()
    return rng.uniform(limits[:, 0], limits[:, 1], (4, robot.n))


@pytest.fixture(params=["kr5_r1400", "ur10", "iiwa14", "crooked"])
def robot_file(request, tmp_path):
    if request.param != "crooked":
        return ROBOTS / f"{request.param}.yaml"
    (tmp_path / "crooked.yaml").write_text(CROOKED)
    return tmp_path / "crooked.yaml"


@pytest.mark.parametrize("form", FORMS)
def test_every_form_has_the_tool_where_the_robot_file_has_it_and_so_has_the_way_back(
    form, robot_file, tmp_path, capsys
):
    there = tmp_path / f"there.{FORMS[form]}"
    assert convert(capsys, robot_file, "--to", form, "-o", there) == (0, "", "")
    text, source = there.read_text(), robot_file.read_text()
    given = ["--repeatability", "0.04"] if form in ("urdf", "dh-csv") else []
    code, back, _ = convert(capsys, there, "--to", "mdh-hayati", *given)
    assert code == 0
    for readings in readings_of(RobotFile.load(robot_file), np.random.default_rng(1)):
        wanted = forward_of_robot_file(source, readings)
        assert_same_pose(forward(text, form, readings), wanted)
        assert_same_pose(forward_of_robot_file(back, readings), wanted)


def any_robot(rng, n):
    """Axes square, parallel, opposite or askew to the one before; joints of either sense with offsets."""
    direction, point, axes = np.array([0.0, 0.0, 1.0]), np.zeros(3), []
    for _ in range(n):
        axes.append(JointAxis.through(point, direction))
        lean = np.deg2rad(rng.choice([0.0, 0.01, 0.5, 90.0, 180.0, rng.uniform(20, 160)]))
        about = np.cross(direction, rng.standard_normal(3))
        about /= np.linalg.norm(about)
        direction = direction * np.cos(lean) + np.cross(about, direction) * np.sin(lean)
        point = point + rng.choice([0.0, 0.05, 1.0]) * rng.uniform(-600, 600, 3)
    home, base, tool = (
        pose_from_xyz_abc(rng.uniform(-500, 500, 3), [rng.uniform(-180, 180), rng.choice([90.0, 12.3]), 0.0])
        for _ in range(3)
    )
    joints = tuple(JointSaid(int(rng.choice([-1, 1])), rng.uniform(-200, 200), -170.0, 170.0, 90.0) for _ in range(n))
    return RobotDescription("any", SerialChain.from_axes(axes, home, base, tool), joints, 0.05)


@pytest.mark.long
@settings(max_examples=40)
@given(st.integers(0, 100_000), st.integers(1, 9))
def test_any_robot_is_the_same_in_every_form_and_read_from_it(tmp_path_factory, seed, n):
    rng = np.random.default_rng(seed)
    robot, folder = any_robot(rng, n), tmp_path_factory.getbasetemp()
    texts = {form: robot_text(robot, form, "any") for form in ("mdh-hayati", "dh-craig", "poe")}
    texts |= {"dh-csv": dh_table_text(robot, "dh-craig"), "urdf": urdf_text(robot)}
    readings = rng.uniform(-170, 170, n)
    wanted = robot.chain.forward(robot.joint_map().model(readings))
    for form, text in texts.items():
        assert_same_pose(forward(text, form, readings), wanted)
        file = folder / f"any.{FORMS[form]}"
        file.write_text(text)
        readers = {
            "yaml": lambda path: RobotDescription.of(RobotFile.load(path)),
            "urdf": load_urdf,
            "csv": load_dh_table,
        }
        found = readers[FORMS[form]](file)
        assert_same_pose(found.chain.forward(found.joint_map().model(readings)), wanted)


@pytest.mark.parametrize("form", ["mdh-hayati", "dh-craig", "poe"])
def test_limits_mass_repeatability_and_tolerances_stay(form, tmp_path, capsys):
    (tmp_path / "crooked.yaml").write_text(CROOKED)
    convert(capsys, tmp_path / "crooked.yaml", "--to", form, "-o", tmp_path / "there.yaml")
    before, after = (RobotFile.load(tmp_path / f"{name}.yaml") for name in ("crooked", "there"))
    assert (after.name, after.joints, after.tool.mass) == (before.name, before.joints, before.tool.mass)
    assert (after.repeatability, after.tolerances) == (before.repeatability, before.tolerances)


@pytest.mark.parametrize("form", ["urdf", "dh-csv"])
def test_limits_and_speeds_survive_a_urdf_and_a_table(form, tmp_path, capsys):
    there = tmp_path / f"there.{FORMS[form]}"
    convert(capsys, ROBOTS / "kr5_r1400.yaml", "--to", form, "-o", there)
    _, back, _ = convert(capsys, there, "--to", "poe", "--repeatability", "0.03")
    (tmp_path / "back.yaml").write_text(back)
    before, after = RobotFile.load(ROBOTS / "kr5_r1400.yaml"), RobotFile.load(tmp_path / "back.yaml")
    np.testing.assert_allclose(after.limits(), before.limits(), atol=1e-9)
    np.testing.assert_allclose(after.max_speeds(), before.max_speeds(), atol=1e-9)


@pytest.fixture
def model():
    """A robot identified elsewhere: every parameter of its chain off by some."""
    robot = RobotFile.load(ROBOTS / "ur10.yaml")
    chain = robot.chain()
    rng = np.random.default_rng(7)
    values = (np.where(chain.parameter_turns, 2e-3, 0.7) * rng.standard_normal(len(chain.parameters))).tolist()
    units = ["rad" if turns else "mm" for turns in chain.parameter_turns]
    limits = robot.limits()
    return ModelFile(
        robot=robot,
        model="geometry",
        start={"base": chain.base.tolist(), "tool": chain.tool.tolist()},
        parameters=[
            Parameter(name=name, unit=unit, value=value, sigma=0.0, prior_sigma=1.0)
            for name, unit, value in zip(chain.parameters, units, values, strict=True)
        ],
        covariance=np.zeros((len(values),) * 2).tolist(),
        joint_region=JointRegion(min=limits[:, 0].tolist(), max=limits[:, 1].tolist()),
        figures={},
        provenance={},
    )


@pytest.mark.parametrize("form", FORMS)
def test_an_identified_robot_leaves_with_its_identified_geometry(form, model, tmp_path, capsys):
    model.save(tmp_path / "model.json")
    code, text, _ = convert(capsys, tmp_path / "model.json", "--to", form)
    assert code == 0
    readings = readings_of(model.robot, np.random.default_rng(2))
    wanted = model.robot_model().pose(model.robot.joint_map().model(readings))
    moved = np.linalg.norm(model.robot.chain().forward(model.robot.joint_map().model(readings)) - wanted, axis=(1, 2))
    assert moved.min() > 0.5
    for row, pose in zip(readings, wanted, strict=True):
        assert_same_pose(forward(text, form, row), pose)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--to", "urdf", "--tip", "tool0"], "--tip"),
        (["--to", "poe", "--repeatability", "0.1"], "says its repeatability"),
        (["--to", "step"], "step"),
        (["--to", "poe", "--table", "dh-craig"], "--table"),
    ],
)
def test_a_call_that_contradicts_itself_is_refused(words, said, capsys):
    code, _, error = convert(capsys, ROBOTS / "ur10.yaml", *words)
    assert code == 2
    assert said in error


def test_a_file_of_no_known_kind_is_refused(tmp_path, capsys):
    (tmp_path / "robot.step").write_text("")
    code, _, error = convert(capsys, tmp_path / "robot.step", "--to", "poe")
    assert code == 2
    assert ".urdf" in error


def test_what_a_robot_file_needs_and_the_source_does_not_say_is_asked_for_not_made_up(tmp_path, capsys):
    (tmp_path / "bare.csv").write_text("theta,d,a,alpha\n0,100,50,90\n0,0,300,0\n")
    code, out, error = convert(capsys, tmp_path / "bare.csv", "--to", "mdh-hayati", "--table", "mdh-hayati")
    assert (code, out) == (2, "")
    assert "min, max, max_speed of joint 2" in error
    assert "--repeatability" in error


def test_a_bare_table_becomes_a_urdf_with_continuous_joints(tmp_path, capsys):
    (tmp_path / "bare.csv").write_text("theta,d,a,alpha\n0,100,50,90\n0,0,300,0\n")
    code, text, _ = convert(capsys, tmp_path / "bare.csv", "--to", "urdf", "--table", "mdh-hayati")
    assert code == 0
    assert text.count('type="continuous"') == 2
    np.testing.assert_allclose(forward_of_urdf(text, "tool0", [0, 0])[:3, 3], [350, 0, 100], atol=1e-9)


def test_axes_too_far_from_square_for_a_table_are_refused_in_words(tmp_path, capsys):
    text = """\
name: skew
convention: poe
screws: [{axis: [0, 0, 1], point: [0, 0, 0]}, {axis: [0, 0.018, 1], point: [500, 19000, 0]}]
home: {xyz: [0, 0, 500], abc: [0, 0, 0]}
joints: [{min: -90, max: 90, max_speed: 10}, {min: -90, max: 90, max_speed: 10}]
repeatability: 0.1
"""
    (tmp_path / "skew.yaml").write_text(text)
    code, _, error = convert(capsys, tmp_path / "skew.yaml", "--to", "mdh-hayati")
    assert code == 2
    assert "links.0.d" in error
