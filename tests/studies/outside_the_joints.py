"""Predictions outside the measured joints: a real UR10, fitted where one joint is low, judged where it is high.

800 rows with the joint below its 40 % quantile to fit, 1500 with it above its 60 % quantile to predict (`r`: the other
way round). The draws (seeds) are of one robot's rows and overlap: their spread is no confidence interval. The
measurements are public (ipa-robot-accuracy data set) and not in this repository.
"""

from __future__ import annotations

import csv
from argparse import Namespace
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

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
from tests.helpers.real_data import JOINTS, REPEATABILITY_MM, UR10_DATA
from tests.studies._runner import Row, Study, Table, each

ROBOT = Path(__file__).parents[2] / "procedures" / "robots" / "ur10.yaml"
FIT, PREDICTED = 800, 1500


@cache
def measured() -> tuple[np.ndarray, np.ndarray]:
    """Joint angles (N, 6), rad, and positions (N, 3), mm."""
    with UR10_DATA.open(newline="") as source:
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


def figures(q: np.ndarray, xyz: np.ndarray, count: int) -> dict[str, Any]:
    """The model of the first `count` rows, and its figures on the others: means, mm, coverage, RMS, log scores."""
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
        "model": found.model,
        "outside_mm": found.region.outside_mm,
        "nominal": found.nominal.mean,
        "geometry": float(rows.pick(np.flatnonzero(held_out)).errors(geometry).mean()),
        "auto": found.test.mean,
        "coverage": found.coverage_95,
        "stated": found.predicted_test_rms,
        "found": found.test.rms,
        "sigma_ok": found.sigma_ok,
        "nominal score": score(found.nominal_errors, np.mean(own.errors(nominal) ** 2)),
        "auto score": score(found.test_errors, predicted.variance),
    }


def score(errors: np.ndarray, variance: np.ndarray | float) -> float:
    """Mean logarithm of the probability density of errors whose 3-D variance, mm², is shared by three axes."""
    each = np.broadcast_to(variance, errors.shape) / 3.0
    return float(np.mean(-0.5 * (errors**2 / each + 3.0 * np.log(2.0 * np.pi * each))))


def line(name: str, each: list[dict[str, Any]]) -> str:
    """A line of the table: mean and range of the draws."""
    of = {key: np.array([one[key] for one in each]) for key in each[0] if key not in ("case", "model", "sigma_ok")}
    better = np.minimum(of["nominal"], of["geometry"])
    stated, found = np.sqrt(np.mean(of["stated"] ** 2)), np.sqrt(np.mean(of["found"] ** 2))
    ratios = of["stated"] / of["found"]
    cells = (
        name,
        str(len(each)),
        *(f"{of[key].mean():.2f}" for key in ("nominal", "geometry")),
        _spread(of["auto"]),
        _spread(of["auto"] / better),
        _spread(100.0 * of["coverage"], 1),
        f"{stated / found:.2f} ({ratios.min():.2f} … {ratios.max():.2f})",
        f"{of['nominal score'].mean():.1f} → {of['auto score'].mean():.1f}",
    )
    return f"| {' | '.join(cells)} |"


def _spread(values: np.ndarray, digits: int = 2) -> str:
    mean, low, high = (f"{value:.{digits}f}" for value in (values.mean(), values.min(), values.max()))
    return f"{mean} ({low} … {high})"


HEAD = (
    "| split | draws | nominal | geometry alone | auto | auto over the better | coverage, % | stated / found RMS "
    "| log score, nominal → auto |\n|---|---|---|---|---|---|---|---|---|"
)


def measure(case: str, seed: int) -> Row:
    """The figures of one draw."""
    (q, xyz), joint = measured(), int(case[1]) - 1
    fitted, predicted = split(q[:, joint], joint, seed, case.endswith("r"))
    rows = np.concatenate([fitted, predicted])
    return figures(q[rows], xyz[rows], len(fitted))


def tables(found: list[Row], asked: Namespace) -> Iterator[Table]:
    """A line for each split."""
    numbers = {case: [row for row in found if row["case"] == case] for case in asked.splits}
    lines = (line(case.replace("r", " reversed"), each) for case, each in numbers.items() if each)
    yield Table("\n".join([HEAD, *lines]))


SPLITS = {"--splits": {"nargs": "+", "default": ["A1", "A2", "A3", "A1r", "A2r", "A3r"]}}
STUDY = Study(
    lambda asked: each(case=asked.splits, seed=asked.seeds), measure, tables, seeds=20, first=0, options=SPLITS
)
