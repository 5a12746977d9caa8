"""Joint readings of a ball in two sockets 50 mm apart, at three places (MUKCa): files for `cellctl fit`, and a robot
file with the ball as its tool."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

from cellctl.cli import ends
from cellctl.cli.verbs import app
from cellctl.formats import ModelFile

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
PLACES = {"panda": ("front", "right", "back-high"), "iiwa14": ("front", "left_back", "raised_left")}


def cellctl(*arguments: object) -> int:
    """The exit code of a command."""
    return ends.exit_code_of(lambda: app([str(argument) for argument in arguments], standalone_mode=False))


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
