"""Predictions outside the measured joints: a real UR10, fitted where one joint is low, judged where it is high.

    uv run python tests/studies/outside_the_joints.py [--reversed] [--joints 1 2 3] [--draws 5]

800 rows with the joint below its 40 % quantile to fit, 1500 with it above its 60 % quantile to predict (`--reversed`:
the other way round). The measurements are public (ipa-robot-accuracy data set) and not in this repository.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))
from real_rows import DATA, JOINTS, REPEATABILITY_MM

from cellctl.calibration import (
    EffectInputs,
    Harmonics,
    JointCompliance,
    JointField,
    PositionRows,
    Postures,
    RobotModel,
    Split,
    Task,
    fit,
    identify,
)
from cellctl.calibration.verdict.heldout import held_out_rows
from cellctl.formats import RobotFile

ROBOT = Path(__file__).parents[2] / "procedures" / "robots" / "ur10.yaml"
FIT, PREDICTED = 800, 1500


def measured() -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (N, 6), rad, and positions (N, 3), mm."""
    with DATA.open(newline="") as source:
        rows = list(csv.DictReader(source, delimiter=";"))
    names = [*(f"{joint}_joint" for joint in JOINTS), *(f"measurement_{axis}" for axis in "xyz")]
    numbers = np.array([[float(row[name].replace(",", ".")) for name in names] for row in rows])
    return numbers[:, :6], numbers[:, 6:]


def split(angle: np.ndarray, joint: int, draw: int, backwards: bool) -> tuple[np.ndarray, np.ndarray]:
    """Rows to fit and rows to predict."""
    low, high = np.quantile(angle, [0.4, 0.6])
    ends = [np.flatnonzero(angle < low), np.flatnonzero(angle > high)]
    begin, other = reversed(ends) if backwards else ends
    rng = np.random.default_rng(1000 * joint + draw)
    return rng.permutation(begin)[:FIT], rng.permutation(other)[:PREDICTED]


def figures(q: np.ndarray, xyz: np.ndarray, count: int) -> dict[str, float]:
    """Of rows of which the first `count` are fitted: means, mm, coverage, RMS stated and found, log scores."""
    chain = RobotFile.load(ROBOT).chain()
    rows = PositionRows(q, xyz, np.full(xyz.shape, REPEATABILITY_MM / np.sqrt(3.0)))
    held_out = np.arange(len(q)) >= count
    field = JointField.of_inputs(EffectInputs(chain, Postures(q)))
    assert field is not None
    task = Task(RobotModel(chain), rows, candidates=(JointCompliance.of(chain), Harmonics(6), field))
    found = fit(task, Split.by_column(held_out))
    predicted = held_out_rows(task, found.identification, task.rows.pick(np.flatnonzero(held_out)), found.reliability)
    own = rows.pick(np.flatnonzero(~held_out))
    nominal = identify(Task(RobotModel(chain), own, groups=frozenset())).identified.state
    geometry = identify(Task(RobotModel(chain), own, groups=frozenset({"geometry", "tool"}))).identified.state
    return {
        "nominal": found.nominal.mean,
        "geometry": float(rows.pick(np.flatnonzero(held_out)).errors(geometry).mean()),
        "auto": found.test.mean,
        "coverage": found.coverage_95,
        "stated": found.predicted_test_rms,
        "found": found.test.rms,
        "nominal score": score(found.nominal_errors, np.mean(own.errors(nominal) ** 2)),
        "auto score": score(found.test_errors, predicted.variance),
    }


def score(errors: np.ndarray, variance: np.ndarray | float) -> float:
    """Mean logarithm of the probability density of errors whose 3-D variance, mm², is shared by three axes."""
    each = np.broadcast_to(variance, errors.shape) / 3.0
    return float(np.mean(-0.5 * (errors**2 / each + 3.0 * np.log(2.0 * np.pi * each))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--joints", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--draws", type=int, default=5)
    parser.add_argument("--reversed", action="store_true")
    asked = parser.parse_args()
    q, xyz = measured()
    head = ("joint", "nominal", "geometry alone", "auto", "auto over the better, worst draw", "coverage")
    print(f"| {' | '.join((*head, 'stated / found RMS', 'log score, nominal → auto'))} |")
    print("|---|---|---|---|---|---|---|---|")
    for joint in asked.joints:
        chosen = [split(q[:, joint - 1], joint - 1, draw, asked.reversed) for draw in range(asked.draws)]
        each = [figures(q[np.concatenate(rows)], xyz[np.concatenate(rows)], len(rows[0])) for rows in chosen]
        of = {name: np.array([one[name] for one in each]) for name in each[0]}
        better = min(of["nominal"].mean(), of["geometry"].mean())
        worst = (of["auto"] / np.minimum(of["nominal"], of["geometry"])).max()
        sure = np.sqrt(np.mean(of["stated"] ** 2) / np.mean(of["found"] ** 2))
        cells = (
            f"A{joint}{' reversed' if asked.reversed else ''}",
            *(f"{of[name].mean():.2f}" for name in ("nominal", "geometry", "auto")),
            f"{of['auto'].mean() / better:.2f}, {worst:.2f}",
            f"{100.0 * of['coverage'].mean():.1f} %",
            f"{sure:.2f}",
            f"{of['nominal score'].mean():.1f} → {of['auto score'].mean():.1f}",
        )
        print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
