"""Measurements of real robots as files and models: a UR10 (ipa-robot-accuracy data set), and two arms with sockets.

`save_real_rows` writes positions for the race with pybotics; `public_data` makes the documented data sets,
`fitted_ur10` the UR10's model from one. `visits` are joint readings of a ball in two sockets 50 mm apart, at three
places (MUKCa), for `cellctl fit`; `with_ball` writes a robot file with the ball as its tool.
"""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from cellctl.calibration import PositionRows, RobotModel, Task
from cellctl.calibration.identification.identify import registered
from cellctl.cli import exit_codes
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile
from cellctl.kinematics import Link, SerialChain

ROOT = Path(__file__).parents[2]
UR10_DATA = ROOT.parent / "shared" / "data" / "ur10_tracker" / "measurements_grid.csv"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
RIGHT = np.pi / 2
LINKS = np.array(
    [
        [0.0, 0.0, 0.0, 127.3],
        [RIGHT, 0.0, 0.0, 0.0],
        [0.0, -612.0, 0.0, 0.0],
        [0.0, -572.3, 0.0, 163.941],
        [RIGHT, 0.0, 0.0, 115.7],
        [-RIGHT, 0.0, 0.0, 92.2],
    ]
)
"""alpha, a, theta, d of each link, after Craig."""
REPEATABILITY_MM = 0.037
FRESH = 300

DATA = ROOT.parent / "shared" / "data"
PLACES = {"panda": ("front", "right", "back-high"), "iiwa14": ("front", "left_back", "raised_left")}


def save_real_rows(path: Path, count: int) -> Path:
    """`count` measured positions and FRESH others, base and tool registered on the former: see `serving.Rows`."""
    with UR10_DATA.open(newline="") as source:
        rows = list(csv.DictReader(source, delimiter=";"))
    chosen = np.random.default_rng(5).permutation(len(rows))[: count + FRESH]
    names = [*(f"{joint}_joint" for joint in JOINTS), *(f"measurement_{axis}" for axis in "xyz")]
    numbers = np.array([[float(rows[row][name].replace(",", ".")) for name in names] for row in chosen])
    q, xyz = numbers[:, :6], numbers[:, 6:]
    sigma = REPEATABILITY_MM / np.sqrt(3.0)
    links = [Link(theta=theta, d=d, a=a, alpha=alpha) for alpha, a, theta, d in LINKS]
    chain = SerialChain.from_links("dh-craig", links, np.eye(4), np.eye(4))
    task = Task(RobotModel(chain), PositionRows(q[:count], xyz[:count], np.full((count, 3), sigma)))
    there = registered(task, task.rows).state.model.chain
    base = np.concatenate([there.base_now[:3, 3], Rotation.from_matrix(there.base_now[:3, :3]).as_euler("ZYX")])
    tool = np.concatenate([there.tool_now[:3, 3], np.zeros(3)])
    held_out = {"held_out_q": q[count:], "held_out_xyz": xyz[count:]}
    np.savez(path, links=LINKS, sigma=sigma, base=base, tool=tool, q=q[:count], xyz=xyz[:count], **held_out)
    return path


def cellctl(*arguments: object) -> int:
    """The exit code of a command."""
    return exit_codes.exit_code_of(lambda: app([str(argument) for argument in arguments], standalone_mode=False))


def visits(robot: str, places: Sequence[str], path: Path) -> Path:
    """The data set of these places, written to `path`."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*(f"q{joint}" for joint in range(1, 8)), "socket", "session"])
        for place in places:
            for hole in ("0", "1"):
                text = (DATA / f"{robot}_sockets" / place / f"hole_{hole}.csv").read_text()
                writer.writerows([*line.split(","), hole, place] for line in text.split())
    return path


def with_ball(robot: str, folder: Path) -> Path:
    """The robot's file with the ball as tool, found from the visits of all places."""
    source = ROOT / "procedures" / "robots" / f"{robot}.yaml"
    data = visits(robot, PLACES[robot], folder / f"{robot}.csv")
    assert cellctl("fit", source, data, "--free", "tool", "--out", folder / "ball.json") in (0, 1)
    x, y, z = ModelFile.load(folder / "ball.json").robot_model().chain.tool_now[:3, 3]
    taught = f"tool: {{xyz: [{x:.3f}, {y:.3f}, {z:.3f}], abc: [0, 0, 0]}}"
    file = folder / f"{robot}.yaml"
    file.write_text(re.sub(r"(?m)^tool: .*$", taught, source.read_text()))
    return file


def public_data(*words: object) -> None:
    """Run `docs/examples/public_data.py`."""
    script = ROOT / "docs" / "examples" / "public_data.py"
    subprocess.run([sys.executable, script, *map(str, words)], check=True)


def fitted_ur10(folder: Path, terms: str = "geometry") -> ModelFile:
    """Fitted in `folder`, which then has `ur10.csv` and `m.json`."""
    public_data(UR10_DATA, "800", "--held-out", "3000", "--temperature", "-o", folder / "ur10.csv")
    words = ["fit", "ur10", str(folder / "ur10.csv"), "--measure", "position", "--model", terms]
    code = exit_codes.exit_code_of(lambda: app([*words, "--out", str(folder / "m.json")], standalone_mode=False))
    assert code == 0
    return ModelFile.load(folder / "m.json")
