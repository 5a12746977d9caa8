"""Error maps on a real UR10, beside scikit-learn's Gaussian process on the same rows (10 minutes).

`measurements_grid.csv` of the public data: 160 or 1000 random poses to fit, 2800 others judge all models. Maps
without geometry begin at the nominal robot with base and tool registered. A study and no test.
"""

from __future__ import annotations

import random
from argparse import Namespace
from collections.abc import Iterator

import numpy as np

from cellctl.calibration import Split, State, fit
from cellctl.calibration.identification.identify import registered
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.formats import DataSet, RobotFile, measurements
from cellctl.installed import robot_file
from tests.helpers.runs import ROOT
from tests.studies._runner import Row, Study, Table, each
from tests.studies.number_of_rows import COLUMNS, positions
from tests.studies.papers.positions import gaussian_process
from tests.studies.papers.statements import Interval
from tests.studies.papers.world import Floats

PUBLIC = ROOT.parent / "shared" / "data"
POSES, JUDGES = {160: 5, 1000: 2}, 2800
"""Poses to fit, with the draws of them; poses that judge."""

MODELS = (
    "auto",
    "geometry",
    "kriging",
    "kriging:weights=equal",
    "kriging:lambda=1e-3",
    "kriging:semivariogram=exponential",
    "geometry+kriging",
    "idw",
    "perceptron:space=joints",
    "geometry+perceptron:space=joints",
)
PROCESSES = {"process": "scikit-learn's Gaussian process", "geometry+process": "the same on `geometry`"}


def measure(poses: int, model: str, seed: int) -> Row:
    """Mean, RMS and largest error of the rows that judge, mm."""
    lines = positions(PUBLIC)
    order = random.Random(seed).sample(range(len(lines)), poses + JUDGES)
    sets = ["fit"] * poses + ["test"] * JUDGES
    rows = [[*map(float, lines[row]), of] for row, of in zip(order, sets, strict=True)]
    data = DataSet.of_records(dict(zip(COLUMNS, row, strict=True)) for row in rows)
    robot = RobotFile.load(robot_file("ur10", ROOT))
    measured = measurements(robot, data, measure="position", model="geometry" if model in PROCESSES else model)
    task, split = measured.task, Split.by_column(np.array([of == "test" for of in measured.sets]))
    if model == "process":
        errors = by_process(task.rows, registered(task, task.rows.pick(split.fit)).state, split, seed)
    elif model == "geometry+process":
        errors = by_process(task.rows, fit(task, split).identification.identified.state, split, seed)
    else:
        errors = np.array(fit(task, split).test_errors)
    return {"mean": errors.mean(), "rms": np.sqrt(np.mean(errors**2)), "max": errors.max()}


def by_process(rows: RowBlocks, state: State, split: Split, seed: int) -> Floats:
    """Errors (M,) of the held-out rows, mm, by a process over the joints that learnt what `state` leaves."""
    q = np.concatenate([block.postures.q for block in rows.blocks])
    left = np.concatenate([-block.deviation(state)[:, :3] for block in rows.blocks])
    ((fitted, held_out),) = split.judged
    process = gaussian_process(q[fitted], left[fitted], seed, restarts=1)
    return np.asarray(np.linalg.norm(left[held_out] - process.errors(q[held_out]), axis=1))


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """A line for each model and number of poses."""
    lines = ["| poses | model | draws | mean | RMS | maximum |", "|---|---|---|---|---|---|"]
    for poses in POSES:
        for model in (*MODELS, *PROCESSES):
            rows = [row for row in found if (row["poses"], row["model"]) == (poses, model)]
            if rows:
                found_of = {key: [row[key] for row in rows] for key in ("mean", "rms", "max")}
                figures = [_text(values) for values in found_of.values()]
                name = PROCESSES.get(model, f"`{model}`")
                lines.append(f"| {poses} | {name} | {len(rows)} | {' | '.join(figures)} |")
    yield Table("\n".join(lines), "maps on the UR10", "UR10: error maps, mm; means with 95 % intervals over the draws")


def _text(values: list[float]) -> str:
    """The mean with its interval; two draws have none to speak of."""
    return Interval.of(values).text(3) if len(values) > 2 else f"{np.mean(values):.3f}"


def units(_: Namespace) -> Iterator[Row]:
    """Each model from each draw."""
    for poses, draws in POSES.items():
        yield from each(poses=[poses], model=(*MODELS, *PROCESSES), seed=range(1, draws + 1))


STUDY = Study(units, measure, tables, writes=True)
