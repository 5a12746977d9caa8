"""`python -m sims truth`: where the simulated robot's tool centre point truly is, for tests and studies alone."""

from __future__ import annotations

import contextlib
import csv
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from sims.cell import read_cell


class TruthError(Exception):
    """The joints cannot be read; the text says where and why."""


def write_truth(cell_file: Path, joints_file: Path, seed: int | None, out: Path) -> int:
    """The true mean TCP in the robot's base frame, mm, at each row's A1…An (deg), as CSV. Returns the number of rows.

    Raises CellError, TruthError, OSError. Nothing is written unless every row can be.
    """
    from sims.world import World  # numpy

    cell = read_cell(cell_file)
    seed = cell.simulate.seed if seed is None else seed
    world = World(replace(cell, simulate=replace(cell.simulate, seed=seed)), seed)
    with joints_file.open(encoding="utf-8-sig", newline="") as stream:
        rows = list(_joints(stream, joints_file, len(cell.robot.joints)))
    places = [world.true_tcp(row) for row in rows]
    with out.open("w", encoding="utf-8", newline="") as target:
        writer = csv.writer(target, lineterminator="\n")
        writer.writerow("XYZ")
        writer.writerows([f"{value:.6f}" for value in place] for place in places)
    return len(rows)


def _joints(stream: TextIO, name: Path, axes: int) -> Iterator[list[float]]:
    rows = csv.reader(stream)
    header = [cell.strip() for cell in next(rows, [])]
    wanted = [f"A{axis}" for axis in range(1, axes + 1)]
    found = [column for column in header if re.fullmatch(r"A[1-9][0-9]*", column)]
    if sorted(found, key=lambda column: int(column[1:])) != wanted:
        raise TruthError(
            f"{name}:1: columns A1…A{axes} are expected, each once; there are {', '.join(header) or 'none'}"
        )
    columns = [header.index(column) for column in wanted]
    for cells in rows:
        if cells:
            yield [_reading(cells, column, f"{name}:{rows.line_num}", header[column]) for column in columns]


def _reading(cells: list[str], column: int, place: str, joint: str) -> float:
    text = cells[column] if column < len(cells) else ""
    with contextlib.suppress(ValueError):
        if math.isfinite(reading := float(text)):
            return reading
    raise TruthError(f"{place}: {joint} is a number of degrees, not '{text}'")
