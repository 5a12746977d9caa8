"""Cube, cycles and table of a test, from cell file and model."""

from __future__ import annotations

import numpy as np

from cellctl.devices.cell import table_correction_deg
from cellctl.files import InputError, Problem
from cellctl.formats import ModelFile, RobotFile, TableFile
from cellctl.formats.table_making import table_of
from cellctl.operations.table import refuse_table
from cellctl.procedure import CellContext, StepContext
from procedures.steps.iso9283.cube import Cube, planned_cube
from procedures.steps.iso9283.cycles import Cycles, cube_rounds
from procedures.steps.iso9283.plans import CubeRound
from procedures.steps.iso9283.rows import CubeRow
from procedures.steps.tracker.compensable import Compensable, Manner
from procedures.steps.tracker.methods import DEFAULT_METHOD
from procedures.steps.tracker.rows import MODEL_FILE


def planned(context: CellContext, edge: float, centre: str, reflectors: int) -> Cube:
    """The cube; centre: `x, y, z`, mm, or empty. Raises InputError."""
    place = None
    if centre.strip():
        try:
            place = np.array([float(part) for part in centre.split(",")])
        except ValueError:
            place = np.zeros(0)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise InputError(Problem("--set centre", 0, 0, f"'{centre}' is no place", "write x, y, z in mm"))
    return planned_cube(context, edge, place, reflectors)


def cube_row(cube: Cube) -> CubeRow:
    """The row of a cube."""
    return CubeRow(
        centre=tuple(cube.centre.tolist()),
        edge=cube.edge,
        points=tuple(map(tuple, cube.points.tolist())),
        readings=tuple(map(tuple, cube.readings.tolist())),
        sides=tuple(tuple(map(tuple, each)) for each in cube.sides.tolist()),
    )


def cube_of(context: StepContext) -> Cube:
    """The recorded cube."""
    row = context.recorded(CubeRow)[-1]
    return Cube(
        np.array(row.centre), row.edge, *(np.array(each, float) for each in (row.points, row.readings, row.sides))
    )


def compensated(context: StepContext, wanted: Cycles) -> tuple[TableFile, list[CubeRound]]:
    """The table of the five points, and the cycles by it. Raises InputError if a point cannot be compensated."""
    model, cube = ModelFile.load(context.artefact(MODEL_FILE)), cube_of(context)
    limit = table_correction_deg(context.cell)
    made = Compensable.of(model, cube.readings, Manner(DEFAULT_METHOD, None, limit))
    if not made.good.all():
        named = (f"P{place}: {reason}" for place, reason in enumerate(made.reasons, 1) if reason)
        cure = "choose a smaller edge, or another centre"
        file = str(context.run_folder / MODEL_FILE)
        raise InputError(Problem(file, 0, 0, f"cannot compensate {each}", cure) for each in named)
    identity = context.identity("robot")
    table = table_of(
        model,
        made.targets,
        made.found,
        serial=identity.serial,
        simulated=identity.simulated,
        run=context.run_name,
        created=context.calendar,
    )
    robot = RobotFile.load(context.robot_file)
    refuse_table(table, context.run_folder / "table.json", identity, robot, limit)
    return table, cube_rounds(context, cube, np.array([row.compensated for row in table.rows]), wanted, by_table=True)
