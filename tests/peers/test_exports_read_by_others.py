"""Exported robots read by programs that we did not write: the same TCP to 1e-6 mm at random postures.

pytransform3d reads the URDFs. xacro reads `calibration.yaml` and expands a URDF from it; its macro is of these tests,
written from the description package's documentation, because that package was not found in the package index.
"""

from __future__ import annotations

import csv
import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.compensation import with_frames
from cellctl.formats import ModelFile
from cellctl.formats.exports import effects_left_out, fitted_geometry, measured_postures
from cellctl.formats.table_making import nominal_chain
from cellctl.kinematics import inverse_pose, pose_from_xyz_abc
from tests.helpers.arms import library_robot, perturbed
from tests.helpers.real_data import UR10_DATA, fitted_ur10

urdf = pytest.importorskip("pytransform3d.urdf")
MACRO = Path(__file__).parent / "own_ur_macro.xacro"
NEAR_MM, NEAR = 1e-6, 1e-9

KR5 = """\
<robot name="user">
  <link name="base_link"/> <link name="l1"/> <link name="l2"/> <link name="l3"/> <link name="l4"/> <link name="l5"/>
  <link name="l6"/> <link name="tool0"/>
  <joint name="a1" type="revolute"><parent link="base_link"/><child link="l1"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 0 -1"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint>
  <joint name="a2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.18 0.07 0"/>
    <axis xyz="0 1 0"/><limit lower="-4" upper="2" effort="0" velocity="1"/></joint>
  <joint name="a3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.6 -0.07 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="3" effort="0" velocity="1"/></joint>
  <joint name="a4" type="revolute"><parent link="l3"/><child link="l4"/><origin xyz="0.2 0 0.04"/>
    <axis xyz="-1 0 0"/><limit lower="-7" upper="7" effort="0" velocity="1"/></joint>
  <joint name="a5" type="revolute"><parent link="l4"/><child link="l5"/><origin xyz="0.42 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="0" velocity="1"/></joint>
  <joint name="a6" type="revolute"><parent link="l5"/><child link="l6"/>
    <axis xyz="-1 0 0"/><limit lower="-7" upper="7" effort="0" velocity="1"/></joint>
  <joint name="flange" type="fixed"><parent link="l6"/><child link="tool0"/><origin xyz="0.08 0 0"
    rpy="0 1.5707963267948966 0"/></joint>
</robot>
"""


def converted(model: ModelFile, folder: Path, *words: str) -> str:
    """The output of `cellctl convert`."""
    model.save(folder / "m.json")
    call = ["convert", str(folder / "m.json"), *words, "-o", str(folder / "out")]
    assert exit_codes.exit_code_of(lambda: app(call, standalone_mode=False)) == 0
    return (folder / "out").read_text()


def read(text: str, joints: list[str], readings_deg, tip: str, root: str):
    """Pose of `tip` in `root` (4, 4), mm, by pytransform3d."""
    tree = urdf.UrdfTransformManager()
    tree.load_urdf(text)
    for joint, reading in zip(joints, np.radians(readings_deg), strict=True):
        tree.set_joint(joint, reading)
    found = tree.get_transform(tip, root).copy()
    found[:3, 3] *= 1000.0
    return found


def assert_same(found, wanted):
    np.testing.assert_allclose(found[:3, 3], wanted[:3, 3], rtol=0, atol=NEAR_MM)
    np.testing.assert_allclose(found[:3, :3], wanted[:3, :3], rtol=0, atol=NEAR)


def random_readings(model, count=20):
    ends_deg = np.clip(model.robot.limits(), -170.0, 170.0)
    return np.random.default_rng(5).uniform(ends_deg[:, 0], ends_deg[:, 1], (count, model.robot.n))


def of_library(name):
    return perturbed(library_robot(name), 11, 2e-3, 0.6)


@pytest.fixture(scope="module")
def real_ur10(tmp_path_factory):
    """The UR10 identified from the measurements of the ipa-robot-accuracy data set."""
    if not UR10_DATA.exists():
        pytest.skip(f"the UR10 measurements are not at {UR10_DATA}")
    return fitted_ur10(tmp_path_factory.mktemp("ur10"))


def chain_of(model):
    """The geometry that is written: of a model with effects that nearest to the whole model."""
    return fitted_geometry(model).chain if effects_left_out(model) else model.robot_model().chain


def assert_urdf_has_the_models_tcp(model, folder):
    text = converted(model, folder, "--to", "urdf")
    names = [f"joint_{joint}" for joint in range(1, model.robot.n + 1)]
    chain = chain_of(model)
    for readings in random_readings(model):
        wanted = chain.forward(model.robot.joint_map().model(readings))
        assert_same(read(text, names, readings, "tcp", "world"), wanted)


@pytest.mark.parametrize("name", ["kr5_r1400", "iiwa14", "ur10"])
def test_pytransform3d_finds_the_models_tcp_in_an_exported_urdf(name, tmp_path):
    assert_urdf_has_the_models_tcp(of_library(name), tmp_path)


def test_pytransform3d_finds_the_models_flange_in_the_users_own_urdf(tmp_path):
    (tmp_path / "user.urdf").write_text(KR5)
    model = of_library("kr5_r1400")
    text = converted(model, tmp_path, "--to", "urdf", "--into", str(tmp_path / "user.urdf"))
    chain, names = model.robot_model().chain, ["a1", "a2", "a3", "a4", "a5", "a6"]
    flange = inverse_pose(chain.base_now) @ chain.forward_flange(model.robot.joint_map().model(np.zeros(6)))
    turned = inverse_pose(flange) @ read(text, names, np.zeros(6), "tool0", "base_link")
    np.testing.assert_allclose(turned[:3, 3], 0.0, atol=NEAR_MM)
    for readings in random_readings(model):
        q = model.robot.joint_map().model(readings)
        wanted = inverse_pose(chain.base_now) @ chain.forward_flange(q) @ turned
        assert_same(read(text, names, readings, "tool0", "base_link"), wanted)


UR_JOINTS = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]


def assert_xacro_has_the_models_flange(model, folder):
    """`tool0` in the controller's base, which is half a turn about z from `base_link`."""
    if importlib.util.find_spec("xacro") is None:
        pytest.skip("xacro is not installed (dependency group 'peers')")
    calibration = converted(model, folder, "--to", "ur-calibration")
    (folder / "calibration.yaml").write_text(calibration)
    run = [sys.executable, "-c", "import xacro; xacro.main()", str(MACRO), f"kinematics:={folder / 'calibration.yaml'}"]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    chain, half = chain_of(model), pose_from_xyz_abc([0.0] * 3, [180.0, 0.0, 0.0])
    rest = None
    for readings in random_readings(model):
        flange = inverse_pose(chain.base_now) @ chain.forward_flange(model.robot.joint_map().model(readings))
        tool0 = half @ read(done.stdout, UR_JOINTS, readings, "tool0", "base_link")
        rest = inverse_pose(tool0) @ flange if rest is None else rest
        assert_same(tool0 @ rest, flange)
    assert np.linalg.norm(rest[:3, 3]) < 3.0  # the flange is that far off axis 6: the TCP in tool0 holds it
    assert np.linalg.norm(rest[:3, :3] - np.eye(3)) < 0.02


@pytest.mark.parametrize("name", ["ur3e", "ur10"])
def test_xacro_and_pytransform3d_find_the_models_robot_in_a_ur_calibration(name, tmp_path):
    assert_xacro_has_the_models_flange(of_library(name), tmp_path)


def test_the_measured_ur10_is_the_same_robot_to_others(real_ur10, tmp_path):
    assert_urdf_has_the_models_tcp(real_ur10, tmp_path)
    assert_xacro_has_the_models_flange(real_ur10, tmp_path)


@pytest.mark.long
def test_a_urdf_of_the_measured_ur10_with_effects_is_far_nearer_to_the_measured_positions_than_nominal(tmp_path):
    """At rows that the fit did not use; the nominal robot has base and tool registered at the model's postures."""
    if not UR10_DATA.exists():
        pytest.skip(f"the UR10 measurements are not at {UR10_DATA}")
    model = fitted_ur10(tmp_path, "geometry+compliance+harmonics")
    tree = converted(model, tmp_path, "--to", "urdf")
    names = [f"joint_{joint}" for joint in range(1, 7)]
    nominal = with_frames(nominal_chain(model), model.robot_model(), measured_postures(model))
    rows = [row for row in csv.DictReader((tmp_path / "ur10.csv").open()) if row["set"] != "fit"][::30]
    q = np.array([[float(row[f"q{joint}"]) for joint in range(1, 7)] for row in rows])
    measured = np.array([[float(row[axis]) for axis in "XYZ"] for row in rows])
    readings = model.robot.joint_map().readings(q)
    written = np.array([read(tree, names, each, "tcp", "world")[:3, 3] for each in readings])
    mean_mm = np.linalg.norm(written - measured, axis=1).mean()
    nominal_mm = np.linalg.norm(nominal.forward(q)[:, :3, 3] - measured, axis=1).mean()
    assert len(rows) == 100
    assert nominal_mm > 0.7
    assert mean_mm < 0.6 * nominal_mm
