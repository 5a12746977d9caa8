"""`python -m sims truth`: the true TCP of the simulated robot, for tests and studies only."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sims.cell import read_cell
from sims.conditions import Conditions
from sims.truth_rows import Row, TruthError, read_rows


def write_truth(cell_file: Path, joints_file: Path, seed: int | None, out: Path, *, pose: bool = False) -> int:
    """The true mean TCP in the robot's base frame, mm, at each row's A1…An (deg), as CSV. Returns the number of rows.

    `pose`: A, B, C of the tool too, degrees. Raises CellError, TruthError, OSError. Nothing is written unless every row
    can be.
    """
    from sims.world import World  # numpy

    cell = read_cell(cell_file)
    seed = cell.simulate.seed if seed is None else seed
    world = World(replace(cell, simulate=replace(cell.simulate, seed=seed)), seed)
    ask = world.true_pose if pose else world.true_tcp
    with joints_file.open(encoding="utf-8-sig", newline="") as stream:
        rows = list(read_rows(stream, joints_file, len(cell.robot.joints)))
    places = [_asked(ask, row) for row in rows]
    with out.open("w", encoding="utf-8", newline="") as target:
        writer = csv.writer(target, lineterminator="\n")
        writer.writerow("XYZABC" if pose else "XYZ")
        writer.writerows([f"{value:.6f}" for value in place] for place in places)
    return len(rows)


def _asked(ask: Callable[[list[float], Conditions], tuple[float, ...]], row: Row) -> tuple[float, ...]:
    try:
        return ask(row.readings, row.conditions)
    except ArithmeticError as error:
        raise TruthError(f"{row.place}: {error}") from None
