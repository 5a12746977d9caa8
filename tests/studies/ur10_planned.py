"""Planned poses of a real UR10 beside random ones of the same 800, 3000 others judge (10 minutes).

`measurements_grid.csv` of the public data. Of each draw of 800 poses (draw 1 is that of docs/reference/data-sets.md)
`cellctl plan --optimal` chooses 20 and 40; random choices of the same draw are fitted beside. The fits are `auto`.
"""

from __future__ import annotations

import random
from argparse import Namespace
from collections.abc import Iterator

import numpy as np

from cellctl.calibration import Split, fit
from cellctl.formats import DataSet, RobotFile, measurements
from cellctl.installed import robot_file
from cellctl.operations.optimal_plan import Aim, OptimalChoice
from tests.helpers.runs import ROOT
from tests.studies._runner import Row, Study, Table, each
from tests.studies.error_maps import PUBLIC
from tests.studies.number_of_rows import COLUMNS, positions

CANDIDATES, JUDGES = 800, 3000
RANDOM = {20: 10, 40: 0}
"""Poses of the fit, with the number of random choices of them from each draw."""


def units(asked: Namespace) -> Iterator[Row]:
    """For each draw of candidates (`seed`) the planned choices, choice 0, and the random ones, 1 … ."""
    for poses, count in RANDOM.items():
        yield from each(poses=[poses], choice=[0], seed=asked.seeds)
        yield from each(poses=[poses], choice=range(1, count + 1), seed=asked.seeds)


def measure(seed: int, poses: int, choice: int) -> Row:
    """Mean, RMS and largest error of the rows that judge, mm."""
    lines, robot = positions(PUBLIC), RobotFile.load(robot_file("ur10", ROOT))
    order = random.Random(seed).sample(range(len(lines)), CANDIDATES + JUDGES)
    candidates, judges = order[:CANDIDATES], order[CANDIDATES:]
    if choice:
        chosen = random.Random(f"{seed} {choice}").sample(candidates, poses)
    else:
        q = np.array([lines[row][:6] for row in candidates], dtype=float)
        chosen = [candidates[at] for at in OptimalChoice(robot, Aim())(robot.joint_map().readings(q), poses)]
    rows = [[*map(float, lines[row]), of] for of, part in (("fit", chosen), ("test", judges)) for row in part]
    data = DataSet.of_records(dict(zip(COLUMNS, row, strict=True)) for row in rows)
    measured = measurements(robot, data, measure="position", model="auto")
    found = fit(measured.task, Split.by_column(np.array([of == "test" for of in measured.sets])))
    errors = np.array(found.test_errors)
    rms = float(np.sqrt(np.mean(errors**2)))
    return {"mean": float(errors.mean()), "rms": rms, "max": float(errors.max()), "model": found.model}


def tables(found: list[Row], _: Namespace) -> Iterator[Table]:
    """Medians and ranges over all draws."""
    lines = ["| poses of the fit | choice | fits | mean | RMS |", "|---|---|---|---|---|"]
    for poses in RANDOM:
        for name, planned in (("`--optimal`", True), ("random", False)):
            rows = [row for row in found if row["poses"] == poses and (row["choice"] == 0) == planned]
            if rows:
                figures = [_spread([row[key] for row in rows]) for key in ("mean", "rms")]
                lines.append(f"| {poses} | {name} | {len(rows)} | {' | '.join(figures)} |")
    yield Table("\n".join(lines), "planned of 800")


def _spread(errors: list[float]) -> str:
    return f"{np.median(errors):.3f} ({min(errors):.3f} … {max(errors):.3f})"


STUDY = Study(units, measure, tables, seeds=5, writes=True)
