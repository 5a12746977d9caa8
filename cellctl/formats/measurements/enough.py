"""Whether the rows differ enough: with repeats of one measurement, any model fits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cellctl.files import InputError, Problem

if TYPE_CHECKING:
    from cellctl.formats.measurements.measured import Measurements

SCATTERED = 5.0
"""Places within this many of their σ of one place are that place."""

_NAMED = 10


def refuse_alike(measured: Measurements) -> None:
    """Raise InputError with fewer different rows than registration needs, or with only one place from an instrument."""
    rows, least = len(measured.lines), measured.task.rows_at_least
    different = len(set(measured.sightings()))
    if different < least:
        repeated = f", but {different} different: the others repeat their postures" if different < rows else ""
        what = f"too few rows to fit where even the registration takes {least}: {rows}{repeated}"
        problem = Problem(measured.data.file, 0, 0, what, "measure in other postures")
        some = [Problem(problem.file, row.line, 0, row.reason) for row in measured.rejected[:_NAMED]]
        raise InputError([problem, *some])
    _refuse_one_place(measured)


def _refuse_one_place(measured: Measurements) -> None:
    """Refuse an instrument's rows with one TCP place at all joints: they cannot register the robot."""
    import numpy as np

    task = measured.task
    if "base" not in task.registered:
        return
    for number, session in enumerate(task.sessions):
        blocks = [block for block in task.rows.blocks if block.session == number and len(block)]
        mine = [(block, places) for block in blocks if (places := block.positions) is not None]
        if not mine:
            continue
        xyz = np.concatenate([places for _, places in mine])
        sigma = np.concatenate([block.sigma[:, :3] for block, _ in mine])
        if len(xyz) > 1 and np.all(np.abs(xyz - np.median(xyz, axis=0)) <= SCATTERED * sigma):
            where = f" of session '{session.name}'" if session.name else ""
            what = f"X, Y, Z{where} are the same place in all {len(xyz)} rows, though the joints differ"
            cure = "measure the tool at other places; a tool held in one place is a socket (column socket)"
            raise InputError(Problem(measured.data.file, 1, 0, what, cure))
