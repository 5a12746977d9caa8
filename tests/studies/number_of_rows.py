"""Accuracy against the number of rows: positions of a real UR10, touches of a simulated KR5 (35 minutes).

UR10 (`measurements_grid.csv` of the public data): the 800 rows of docs/reference/data-sets.md are drawn from, and its
3000 others judge; then rows near one posture; then of 1500 rows at random the first ones, and those that `cellctl plan
--optimal` would choose. KR5: one campaign of 120 + 30 touches for each robot; random ones of the
120 identify, the 30 and the simulator's truth over the workspace judge. Prints a line for each fit. A study and no
test: it judges nothing.
"""

from __future__ import annotations

import csv
import json
import random
import tempfile
from argparse import Namespace
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cellctl.formats import ModelFile, RobotFile
from cellctl.installed import shipped
from cellctl.operations.optimal_plan import Aim, OptimalChoice
from tests.helpers.runs import CELL, ROOT, cellctl
from tests.helpers.simulated_data import volumetric_errors
from tests.studies._runner import Row, Study, Table, each

JOINTS = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
MEASURED = [f"measurement_{name}" for name in ("x", "y", "z", "temperature")]
COLUMNS = ["q1", "q2", "q3", "q4", "q5", "q6", "X", "Y", "Z", "temperature", "set"]
NEAR = 1000
"""Rows nearest to one posture, from which the rows *near one posture* are drawn."""
CANDIDATES = 1500
"""Random rows of which some are chosen."""
CHOICES = {"at random": "", "optimal": "auto", "optimal for geometry": "geometry"}
"""How they are chosen, and under which model."""

Line = Sequence[str]


def units(asked: Namespace) -> Iterator[Row]:
    """Each fit of the UR10, and each robot of the KR5."""
    ur10 = {"robot": ["UR10"], "public": [str(asked.public)]}
    for seed in range(1, asked.draws + 1):
        yield from each(**ur10, poses=(10, 20, 40, 80, 160, 320), near=[False], seed=[seed])
        yield from each(**ur10, poses=(40, 160), near=[True], seed=[seed])
        yield from each(**ur10, poses=(20, 40, 80), choice=CHOICES, seed=[seed])
    yield from each(**ur10, poses=[800], near=[False], seed=[0])
    yield from each(robot=["KR5"], seed=asked.seeds)


def measure(robot: str, seed: int, public: str = "", poses: int = 0, near: bool = False, choice: str = "") -> Row:
    """The figures of the robot's fits: one of the UR10, all of the KR5."""
    with tempfile.TemporaryDirectory() as folder:
        if robot == "KR5":
            return {"fits": list(of_touches(seed, Path(folder)))}
        if choice:
            return {"fits": [of_chosen(Path(public), poses, choice, seed, Path(folder))]}
        return {"fits": [of_positions(Path(public), poses, near, seed, Path(folder))]}


@cache
def positions(public: Path) -> list[Line]:
    """The UR10's rows: joints, position, temperature."""
    with (public / "ur10_tracker" / "measurements_grid.csv").open(newline="") as source:
        rows = csv.DictReader(source, delimiter=";")
        return [[row[name].replace(",", ".") for name in JOINTS + MEASURED] for row in rows]


def of_positions(public: Path, count: int, near: bool, seed: int, folder: Path) -> Row:
    """Rows spread over the grid, or near one posture; seed 0: all that are not for judging."""
    lines = positions(public)
    order = random.Random(1).sample(range(len(lines)), 3800)
    pool, judges = order[:800], order[800:]
    if near:
        joints = np.array([line[:6] for line in lines], dtype=float)
        centre = joints[random.Random(seed).choice(pool)]
        rest = sorted(set(range(len(lines))) - set(judges))
        nearest = sorted(rest, key=lambda index: float(np.sum((joints[index] - centre) ** 2)))[:NEAR]
        chosen = random.Random(seed).sample(nearest, count)
    else:
        chosen = random.Random(seed).sample(pool, count) if seed else pool
    rows = [[*lines[index], name] for name, part in (("fit", chosen), ("test", judges)) for index in part]
    return fitted("ur10", [COLUMNS, *rows], folder)


def of_chosen(public: Path, count: int, choice: str, seed: int, folder: Path) -> Row:
    """Rows chosen among random ones, none of them for judging."""
    lines = positions(public)
    order = random.Random(1).sample(range(len(lines)), len(lines))
    candidates = random.Random(seed).sample(order[:800] + order[3800:], CANDIDATES)
    chosen = candidates[:count]
    if model := CHOICES[choice]:
        robot = RobotFile.load(shipped("robot")["ur10"])
        readings = robot.joint_map().readings(np.array([lines[row][:6] for row in candidates], dtype=float))
        chosen = [candidates[at] for at in OptimalChoice(robot, Aim(model=model))(readings, count)]
    rows = [[*lines[row], name] for name, part in (("fit", chosen), ("test", order[800:3800])) for row in part]
    return fitted("ur10", [COLUMNS, *rows], folder)


def of_touches(seed: int, folder: Path) -> Iterator[Row]:
    """Random ones of 120 planned touches."""
    runs, result = folder / "runs", folder / "run.json"
    counts = ("touches_fit=120", "touches_test=30", "standoff_targets=3")
    settings = [word for count in counts for word in ("--set", count)]
    cellctl("run", "sphere_selfcal", "--seed", str(seed), *settings, "--runs", runs, "--json", result)
    with (runs / json.loads(result.read_text())["run"] / "dataset.csv").open(newline="") as source:
        head, *lines = csv.reader(source)
    fit = [line for line in lines if line[head.index("set")] == "fit"]
    judges = [line for line in lines if line[head.index("set")] == "test"]
    for count in (18, 25, 35, 50, 80, 120):
        for draw in range(3 if count < len(fit) else 1):
            chosen = random.Random(draw).sample(fit, count)
            found = fitted("kr5_r1400", [head, *chosen, *judges], folder, "--artefact", CELL)
            errors = volumetric_errors(ModelFile.load(folder / "model.json"), CELL, seed, folder)
            yield {"touches": count, "draw": draw, **found, "workspace_rms": float(np.sqrt(np.mean(errors**2)))}


def fitted(robot: str, rows: Sequence[Line], folder: Path, *words: str | Path) -> Row:
    """Figures of `cellctl fit` on these rows; the first one has the names."""
    data, result, model = folder / "rows.csv", folder / "fit.json", folder / "model.json"
    with data.open("w", newline="") as target:
        csv.writer(target).writerows(rows)
    done = cellctl("fit", robot, data, "--column", "set", *words, "--out", model, "--json", result)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    found: dict[str, Any] = json.loads(result.read_text())
    names = ("verdict", "predicted_test_rms", "predicted_volumetric_rms")
    return {"mean": found["test"]["mean"], **{name: found.get(name) for name in names}}


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """A line for each fit."""
    for row in found:
        for fit in row["fits"]:
            if row["robot"] == "KR5":
                title = f"KR5 {row['seed']}, {fit['touches']} touches, draw {fit['draw']}:"
                predicted = f"workspace RMS {fit['workspace_rms']:.3f}, predicted {fit['predicted_volumetric_rms']:.3f}"
            else:
                how = f" {row['choice']}" if "choice" in row else " near one" if row["near"] else ""
                draw = f"{how}, draw {row['seed']}" if row["seed"] else ""
                title = f"UR10, {row['poses']} poses{draw}:"
                predicted = f"predicted RMS {fit['predicted_test_rms']:.3f}"
            yield Table(f"{title} mean {fit['mean']:.3f}, {predicted} {fit['verdict']}")


OPTIONS = {
    "--draws": {"type": int, "default": 5, "help": "of the UR10's rows; the seeds are simulated KR5 (5)"},
    "--public": {"type": Path, "default": ROOT.parent / "shared" / "data", "help": "folder of public data"},
}
STUDY = Study(units, measure, tables, seeds=3, options=OPTIONS)
