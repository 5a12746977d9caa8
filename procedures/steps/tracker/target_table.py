"""Compensated joints for the held-out poses, as a table and as plans for the steps that move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.devices.cell import table_correction_deg
from cellctl.files import InputError
from cellctl.formats import ModelFile, TableFile, postures_of
from cellctl.formats.table_making import compensated_targets, nominal_chain, table_of, valid_region
from cellctl.kinematics import Bools, Floats
from cellctl.procedure import StepContext
from procedures.steps.tracker.plans import PosePlan, Round
from procedures.steps.tracker.rows import PoseRow, ReturnRow, TargetsRow
from procedures.steps.tracker.sessions import Sessions
from procedures.steps.tracker.turn_planning import APPROACH_DEG, return_pose, rounded, turn_posture

_SHARE_OF_LIMIT = 0.9
"""A target whose correction is nearer to the cell's limit is left out: the posture is near a singularity."""


@final
@dataclass(frozen=True, slots=True)
class Prepared:
    """The targets in rounds, the text of the table file, the row to record, and a line for the operator."""

    rounds: list[Round]
    table: str
    row: TargetsRow
    sentence: str


def compensated_rounds(context: StepContext, monuments_every: int, method: str) -> Prepared:
    """The table of the held-out poses, and their plans. Targets: where the registered nominal robot would be, in the
    instrument's frame of the first session. Raises InputError if no target can be compensated.
    """
    model = ModelFile.load(context.run_folder / "model.json")
    sessions = Sessions.of(context)
    rows = [row for row in context.recorded(PoseRow) if row.set == "test"]
    known = [row for row in rows if sessions.session(row.visit)]
    readings = np.array([row.commanded for row in known])
    targets = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    found = compensated_targets(model, targets, readings, method=method)
    commanded = model.robot.joint_map().readings(found.compensated_q)
    region = valid_region(model)
    inside = ((commanded >= region.min) & (commanded <= region.max)).all(axis=1)
    good = _good(context, found.converged & inside, commanded - readings)
    if not good.any():
        what = "no held-out pose can be compensated within the limit of a correction"
        raise InputError(context.cell.problem(("limits",), what, "limits: {table: {correction_deg: …}}"))
    known = [row for row, is_good in zip(known, good, strict=True) if is_good]
    identity = context.identity("robot")
    table = table_of(
        model,
        targets[good],
        compensated_targets(model, targets[good], readings[good], method=method),
        method=method,
        serial=identity.serial,
        simulated=identity.simulated,
        run=context.run_name,
        created=context.calendar,
    )
    left_out = tuple(sorted({row.number for row in rows} - {row.number for row in known}))
    row = TargetsRow(
        table=table.id,
        rows=len(table.rows),
        created=table.created,
        max_correction_deg=table.max_correction_deg,
        left_out=left_out,
    )
    plans = _plans(context, table, known)
    first = 1 + max(each.number for each in (*context.recorded(PoseRow), *context.recorded(ReturnRow)))
    rounds = [
        _round(context, plans[start : start + monuments_every], first + number)
        for number, start in enumerate(range(0, len(plans), monuments_every))
    ]
    sentence = f"{row.rows} held-out poses compensated, joints by up to {row.max_correction_deg:.3f}°"
    if left_out:
        sentence += f"; {len(left_out)} left out: near a singularity, at the edge of the fit's joints, or ambiguous"
    return Prepared(rounds, table.text(), row, sentence)


def _good(context: StepContext, reached: Bools, corrections: Floats) -> Bools:
    """Which targets (N,) get a row: those reached inside the measured region, with a correction below the limit."""
    limit = _SHARE_OF_LIMIT * table_correction_deg(context.cell)
    return np.asarray(reached & (np.abs(corrections).max(axis=1) < limit))


def _plans(context: StepContext, table: TableFile, rows: list[PoseRow]) -> list[PosePlan]:
    """The targets in the order in which they were measured before; each is reached over home, by its first approach."""
    home = _home(context)
    plans: list[PosePlan] = []
    for number, (entry, row) in enumerate(zip(table.rows, rows, strict=True), 1):
        joints = np.array(entry.compensated)
        origin = plans[-1].joints if plans else rounded(turn_posture(context))
        plans.append(
            PosePlan(
                number=row.number,
                kind="compensated",
                reflector=row.reflector,
                origin=origin,
                way=[home, rounded(joints - APPROACH_DEG * np.array(row.direction))],
                joints=rounded(joints),
                direction=list(row.direction),
                row=number,
                target=[entry.target[0], entry.target[1], entry.target[2]],
            )
        )
    return plans


def _round(context: StepContext, poses: list[PosePlan], number: int) -> Round:
    home = _home(context)
    first = poses[0].model_copy(update={"origin": rounded(turn_posture(context))})
    back = return_pose(context, poses[-1].joints, number)
    return Round(poses=[first, *poses[1:]], back=back.model_copy(update={"way": [home, *back.way]}))


def _home(context: StepContext) -> list[float]:
    model = ModelFile.load(context.run_folder / "model.json")
    return rounded(postures_of(context.cell, model.robot, "turn").home)
