"""`python -m sims truth`: the true TCP of the simulated robot, or a reflector on it, for tests and studies only."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sims.cell import CellError, SimCell, read_cell
from sims.conditions import Conditions
from sims.truth_rows import Row, TruthError, read_rows

if TYPE_CHECKING:
    from sims.world import World

Ask = Callable[[Sequence[float], Conditions], tuple[float, ...]]


def write_truth(
    cell_file: Path, joints_file: Path, seed: int | None, out: Path, *, pose: bool = False, reflector: str | None = None
) -> int:
    """The true mean TCP in the robot's base frame, mm, at each row's A1…An (deg), as CSV. Returns the number of rows.

    `pose`: A, B, C of the tool too, degrees. `reflector`: the true place of this one on the robot instead of the TCP.
    Raises CellError, TruthError, OSError. Nothing is written unless every row can be.
    """
    from sims.world import World  # numpy

    cell = read_cell(cell_file)
    seed = cell.simulate.seed if seed is None else seed
    cell = replace(cell, simulate=replace(cell.simulate, seed=seed))
    world = World(cell, seed)
    ask: Ask = world.true_pose if pose else world.true_tcp
    if reflector is not None:
        ask = _asking_for(reflector, cell, world)
    with joints_file.open(encoding="utf-8-sig", newline="") as stream:
        rows = list(read_rows(stream, joints_file, len(cell.robot.joints)))
    places = [_asked(ask, row) for row in rows]
    with out.open("w", encoding="utf-8", newline="") as target:
        writer = csv.writer(target, lineterminator="\n")
        writer.writerow("XYZABC" if pose else "XYZ")
        writer.writerows([f"{value:.6f}" for value in place] for place in places)
    return len(rows)


def _asking_for(name: str, cell: SimCell, world: World) -> Ask:
    """Gives the true place of a reflector on the robot. Raises CellError: the cell has none of this name."""
    from sims.world.reflectors import TrueReflectors

    names = [one.id for one in cell.reflectors.on_flange] if cell.reflectors else []
    if cell.reflectors is None or name not in names:
        raise CellError(
            cell.path, [f"reflectors: no reflector '{name}' on the robot; it has {', '.join(names) or 'none'}"]
        )
    true = TrueReflectors(cell.reflectors, cell.simulate.seed, cell.simulate.errors["reflector"])
    rank = names.index(name)
    return lambda readings, conditions: true.at(world.true_flange(readings, conditions), 0.0)[rank].xyz


def _asked(ask: Ask, row: Row) -> tuple[float, ...]:
    try:
        return ask(row.readings, row.conditions)
    except ArithmeticError as error:
        raise TruthError(f"{row.place}: {error}") from None
