"""Accuracy against the number of rows: positions of a real UR10, touches of a simulated KR5 (25 minutes).

    uv run python tests/studies/number_of_rows.py [--draws 5] [--robots 3] [--public FOLDER]

UR10 (`measurements_grid.csv` of the public data): the 800 rows of docs/reference/data-sets.md are drawn from, and its
3000 others judge; then rows near one posture. KR5: one campaign of 120 + 30 touches for each robot; random ones of the
120 identify, the 30 and the simulator's truth over the workspace judge. Prints a line for each fit. A study and no
test: it judges nothing.
"""

from __future__ import annotations

import argparse
import csv
import json
import random
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from cell_runs import CELL, ROOT, cellctl
from volumetric import volumetric_errors

from cellctl.formats import ModelFile

JOINTS = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
MEASURED = [f"measurement_{name}" for name in ("x", "y", "z", "temperature")]
COLUMNS = ["q1", "q2", "q3", "q4", "q5", "q6", "X", "Y", "Z", "temperature", "set"]
NEAR = 1000
"""Rows nearest to one posture, from which the rows *near one posture* are drawn."""

Row = Sequence[str]


def main() -> None:
    """Both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=5, help="of the UR10's rows")
    parser.add_argument("--robots", type=int, default=3, help="simulated KR5, seeds from 1")
    parser.add_argument("--public", type=Path, default=ROOT.parent / "shared" / "data", help="folder of public data")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        of_positions(asked.public / "ur10_tracker" / "measurements_grid.csv", asked.draws, Path(folder))
        for seed in range(1, asked.robots + 1):
            of_touches(seed, Path(folder))


def of_positions(file: Path, draws: int, folder: Path) -> None:
    """Rows spread over the grid, and rows near one posture."""
    with file.open(newline="") as source:
        lines = [
            [row[name].replace(",", ".") for name in JOINTS + MEASURED] for row in csv.DictReader(source, delimiter=";")
        ]
    order = random.Random(1).sample(range(len(lines)), 3800)
    pool, judges = order[:800], order[800:]
    rest = sorted(set(range(len(lines))) - set(judges))
    joints = np.array([line[:6] for line in lines], dtype=float)

    def rows(chosen: Iterable[int], name: str) -> list[Row]:
        return [[*lines[index], name] for index in chosen]

    def one(title: str, chosen: Iterable[int]) -> None:
        found = fitted("ur10", [COLUMNS, *rows(chosen, "fit"), *rows(judges, "test")], folder)
        print(
            title,
            f"mean {found['test']['mean']:.3f}, predicted RMS {found['predicted_test_rms']:.3f}",
            found["verdict"],
        )

    for seed in range(1, draws + 1):
        for count in (10, 20, 40, 80, 160, 320):
            one(f"UR10, {count} poses, draw {seed}:", random.Random(seed).sample(pool, count))
        centre = joints[random.Random(seed).choice(pool)]
        near = sorted(rest, key=lambda index: float(np.sum((joints[index] - centre) ** 2)))[:NEAR]
        for count in (40, 160):
            one(f"UR10, {count} poses near one, draw {seed}:", random.Random(seed).sample(near, count))
    one("UR10, 800 poses:", pool)


def of_touches(seed: int, folder: Path) -> None:
    """Random ones of 120 planned touches."""
    runs, result = folder / f"runs{seed}", folder / f"run{seed}.json"
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
            print(
                f"KR5 {seed}, {count} touches, draw {draw}: mean {found['test']['mean']:.3f}, workspace RMS "
                f"{np.sqrt(np.mean(errors**2)):.3f}, predicted {found['predicted_volumetric_rms']:.3f}",
                found["verdict"],
            )


def fitted(robot: str, rows: Sequence[Row], folder: Path, *words: str | Path) -> dict[str, Any]:
    """The JSON of `cellctl fit` on these rows; the first one has the names."""
    data, result, model = folder / "rows.csv", folder / "fit.json", folder / "model.json"
    with data.open("w", newline="") as target:
        csv.writer(target).writerows(rows)
    done = cellctl("fit", robot, data, "--column", "set", *words, "--out", model, "--json", result)
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    found: dict[str, Any] = json.loads(result.read_text())
    return found


if __name__ == "__main__":
    main()
