"""A compensated URScript program, executed by the simulated UR10e, whose true arm is known.

The controller has a calibration of its own that knows a part of the arm's errors. It is read as `calibration.conf`,
the fit starts from it, and the program's poses are in it.
"""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.formats import ModelFile, RobotFile
from sims.ur._kinematics import nominal_rows
from tests.helpers.arms import cellctl as command
from tests.helpers.arms import library_robot
from tests.helpers.simulated_data import best_rigid
from tests.sims.ur.conftest import CELL, Bench

ERRORS = {"geometry": 1.0, "joint_zero": 1.0, "compliance": 1.0}
TOOL_MM = 150.0
MIDDLE = np.array([10.0, -80.0, 100.0, -110.0, -90.0, 5.0])


def drawn(count, seed, width):
    return MIDDLE + np.random.default_rng(seed).uniform(-width, width, (count, 6))


@pytest.fixture(scope="module")
def bench():
    found = Bench(CELL, ERRORS)
    yield found
    found.stop()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def calibration_conf(rows):
    """The file of a controller with these rows: their differences from the data sheet's."""
    sheet = nominal_rows(CELL.robot)
    lines = ["[mounting]"]
    for name in ("theta", "a", "d", "alpha"):
        values = [getattr(row, name) - getattr(usual, name) for row, usual in zip(rows, sheet, strict=True)]
        lines.append(f"delta_{name} = [ {', '.join(map(repr, values))}]")
    return "\n".join(
        [*lines, "calibration_status = 2 # 0 == notInitialized / 1 == notLinearised / 2 == Linearised", ""]
    )


def true_points(bench, readings):
    return np.array([bench.scene.world.true_tcp(row) for row in readings])


@pytest.fixture
def model(bench, folder):
    """`robot.yaml` by the controller's calibration with the tool, and `model.json` fitted from true points."""
    (folder / "calibration.conf").write_text(calibration_conf(bench.motion.model.rows))
    assert command("convert", "calibration.conf", "--robot", "ur10e", "--to", "mdh-hayati", "-o", "arm.yaml") == 0
    text = (folder / "arm.yaml").read_text()
    tool = f"tool: {{xyz: [0, 0, {TOOL_MM}], abc: [0, 0, 0], mass: 1.0}}"
    (folder / "robot.yaml").write_text(re.sub(r"^tool: .*$", tool, text, flags=re.MULTILINE))
    readings = drawn(90, 1, 35.0)
    rows = np.hstack([readings, true_points(bench, readings)])
    names = [*(f"A{axis}" for axis in range(1, 7)), *"XYZ"]
    (folder / "data.csv").write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows.tolist())]))
    words = ("fit", "robot.yaml", "data.csv", "--model", "geometry+compliance", "--out", "model.json")
    assert command(*words) == 0
    return ModelFile.load(folder / "model.json")


def numbers(pose):
    vector = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    return ", ".join(repr(value) for value in [*(pose[:3, 3] / 1000.0).tolist(), *vector.tolist()])


def program(wanted, chain):
    """Moves to joints, to poses, in a feature; after each one it says where its joints are."""
    feature = np.eye(4)
    feature[:3, :3] = Rotation.from_euler("ZYX", [30, 4, -3], degrees=True).as_matrix()
    feature[:3, 3] = [400.0, -200.0, 100.0]
    lines = [f"set_tcp(p[0, 0, {TOOL_MM / 1000}, 0, 0, 0])", f"global Table = p[{numbers(feature)}]"]
    for number, readings in enumerate(wanted):
        joints = f"[{', '.join(map(repr, np.radians(readings).tolist()))}]"
        pose = chain.forward(np.radians(readings))
        if number % 3 == 0:
            lines.append(f"movej({joints}, a=6, v=3)")
        elif number % 3 == 1:
            lines += [
                f"global P{number} = p[{numbers(pose)}]",
                f"movej(get_inverse_kin(P{number}, qnear={joints}), a=6, v=3)",
            ]
        else:
            seen = numbers(np.linalg.inv(feature) @ pose)
            lines.append(f"movel(pose_trans(Table, p[{seen}]), a=3, v=1)")
        lines += ["sleep(0.3)", "textmsg(get_target_joint_positions())"]
    return "def part():\n" + "".join(f"  {line}\n" for line in lines) + "end\n"


def executed(bench, text):
    """Readings (N, 6), deg, at which the controller stops."""
    del bench.log[:]
    bench.controller.runtime.take(text)
    bench.until(lambda: not bench.controller.runtime.active)
    found = [re.findall(r"-?\d+\.\d+(?:e-?\d+)?", str(each)) for each in bench.log]
    return np.degrees([[float(part) for part in each] for each in found if len(each) == 6])


def off(places, goals):
    return float(np.sqrt(np.mean(np.sum((places - goals) ** 2, axis=1))))


@pytest.mark.long
def test_the_true_tool_is_nearer_to_the_programs_points(bench, model, folder):
    robot = RobotFile.load(folder / "robot.yaml")
    assert robot.calibration is not None
    wanted = drawn(15, 2, 20.0)
    chain = robot.chain()
    (folder / "part.script").write_text(program(wanted, chain))
    (folder / "out").mkdir()
    assert command("compensate", "model.json", "part.script", "-o", "out", "--json", "all.json") == 0
    figures = json.loads((folder / "all.json").read_text())
    assert figures["compensated"] == len(wanted)
    goals = chain.forward(np.radians(wanted))[:, :3, 3]
    before, after = (
        true_points(bench, executed(bench, (place / "part.script").read_text())) for place in (folder, folder / "out")
    )
    assert len(before) == len(after) == len(wanted)
    # the floor: what the model leaves of the arm's errors at the points themselves
    base = model.robot_model().chain.base_now
    fitted = np.asarray(model.robot_model().pose(np.radians(wanted)))[:, :3, 3]
    floor = off(fitted, true_points(bench, wanted))
    placed = goals @ base[:3, :3].T + base[:3, 3]
    assert off(best_rigid(before, goals).apply(before), goals) > 0.2
    assert off(after, placed) < 0.01 + 1.5 * floor
    assert off(best_rigid(after, goals).apply(after), goals) < 0.01 + 1.5 * floor


def test_the_controllers_kinematics_are_read_to_a_nanometre(bench, folder):
    """Rows with lengths of metres to hundreds of metres, as calibrations of real arms have."""
    rows = bench.motion.model.rows
    assert max(abs(row.d) for row in rows) > 10.0
    (folder / "calibration.conf").write_text(calibration_conf(rows))
    assert command("convert", "calibration.conf", "--robot", "ur10e", "--to", "mdh-hayati", "-o", "arm.yaml") == 0
    chain = RobotFile.load(folder / "arm.yaml").chain()
    assert library_robot("ur10e").tool.xyz == [0.0, 0.0, 0.0]
    for readings in np.random.default_rng(3).uniform(-180.0, 180.0, (200, 6)):
        q = np.radians(readings)
        wanted = bench.motion.model.flange(tuple(q))
        found = chain.forward(q)
        assert np.linalg.norm(found[:3, 3] - 1000.0 * wanted[:3, 3]) < 1e-6
        np.testing.assert_allclose(found[:3, :3], wanted[:3, :3], rtol=0, atol=1e-9)
