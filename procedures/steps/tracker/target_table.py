"""Compensated joints for the held-out poses as table and plans, and why a target gets no row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, Self, final

import numpy as np

from cellctl.compensation import Compensated
from cellctl.devices import online_correction_deg, table_correction_deg
from cellctl.files import InputError
from cellctl.formats import (
    ModelFile,
    TableFile,
    compensated_targets,
    nominal_chain,
    postures_of,
    row_problems,
    table_of,
    target_rows,
    valid_region,
)
from cellctl.kinematics import Bools, Floats
from cellctl.procedure import CellContext, StepContext
from procedures.steps.tracker.circles import APPROACH_DEG, return_pose, rounded, turn_posture
from procedures.steps.tracker.pose_plans import PosePlan, Round
from procedures.steps.tracker.rows import PoseRow, ReturnRow, TargetsRow
from procedures.steps.tracker.station import Sessions


@final
@dataclass(frozen=True, slots=True)
class CompensationSettings:
    """How targets are compensated: method, the most passes (None: until it converges), the cell's limit, deg."""

    method: str
    passes: int | None
    limit_deg: float

    @property
    def name(self) -> str:
        """As a table file names it."""
        made = "" if self.passes is None else f", {self.passes} pass{'' if self.passes == 1 else 'es'}"
        return f"{self.method}{made}"


class CompensationInputs(Protocol):
    """The part of a step's settings that says how targets are compensated."""

    @property
    def method(self) -> str:
        """Method of compensation."""

    @property
    def passes(self) -> int:
        """Passes of the method, 0: until it converges."""

    @property
    def online(self) -> bool:
        """Whether the robot goes to the nominal joints and is corrected on-line."""


_OF_ONLINE_LIMIT = 0.9
"""Share of the on-line limit that a target may need: a correction keeps room for braking before it."""


def compensation_settings(context: CellContext, inputs: CompensationInputs) -> CompensationSettings:
    """How a step compensates in this cell."""
    limit = table_correction_deg(context.cell)
    if inputs.online:
        limit = min(limit, _OF_ONLINE_LIMIT * online_correction_deg(context.cell))
    return CompensationSettings(inputs.method, inputs.passes or None, limit)


@final
@dataclass(frozen=True, eq=False)
class Compensable:
    """N targets (N, 4, 4), mm, in the model's frame, their nominal readings (N, n), deg, and the joints found.

    reasons: why each gets no row, empty where it gets one.
    """

    targets: Floats
    readings: Floats
    found: Compensated
    reasons: tuple[str, ...]

    @classmethod
    def of(cls, model: ModelFile, readings: Floats, settings: CompensationSettings) -> Self:
        """Of the targets where the registered nominal robot would be at `readings` (N, n), deg."""
        targets = nominal_chain(model).forward(model.robot.joint_map().model(readings))
        found = compensated_targets(model, targets, readings, method=settings.method, passes=settings.passes)
        rows = target_rows(model, targets, found)
        refused = row_problems(rows, valid_region(model), model.robot, settings.limit_deg)
        pairs = zip(found.reasons, refused, strict=True)
        reasons = tuple(reason or next(iter(of_row), "") for reason, of_row in pairs)
        return cls(targets, readings, found, reasons)

    @property
    def good(self) -> Bools:
        """Which targets (N,) get a row."""
        return np.array([not reason for reason in self.reasons], bool)


@final
@dataclass(frozen=True, slots=True)
class Prepared:
    """The targets in rounds, the text of the table file, the row to record, and a line for the operator."""

    rounds: list[Round]
    table: str
    row: TargetsRow
    sentence: str


class CompensatedRoundsInputs(CompensationInputs, Protocol):
    """The procedure's settings."""

    @property
    def monuments_every(self) -> int:
        """Targets between two visits to the monuments."""


def compensated_rounds(context: StepContext, inputs: CompensatedRoundsInputs) -> Prepared:
    """The table of the held-out poses, and their plans. Targets: where the registered nominal robot would be, in the
    instrument's frame of the first session. Raises InputError if no target can be compensated.
    """
    model, settings = ModelFile.load(context.artefact("model.json")), compensation_settings(context, inputs)
    sessions, rows = Sessions.of(context), [row for row in context.recorded(PoseRow) if row.set == "test"]
    known = [row for row in rows if sessions.session(row.visit)]
    if not known:
        what = f"no held-out pose can be compensated: {_AMBIGUOUS}"
        raise InputError(context.cell.problem(("station",), what, "stand the instrument firmly, then begin anew"))
    tried = Compensable.of(model, np.array([row.commanded for row in known]), settings)
    if not tried.good.any():
        what = f"no held-out pose can be compensated; the first one: {tried.reasons[0]}"
        raise InputError(context.cell.problem(("limits",), what, "limits: {table: {correction_deg: …}}"))
    used = [row for row, is_good in zip(known, tried.good, strict=True) if is_good]
    table = _table(context, model, Compensable.of(model, tried.readings[tried.good], settings), settings)
    reasons = {row.number: reason for row, reason in zip(known, tried.reasons, strict=True)}
    left_out = sorted({row.number for row in rows} - {row.number for row in used})
    row = TargetsRow(
        table=table.id,
        rows=len(table.rows),
        created=table.created,
        max_correction_deg=table.max_correction_deg,
        left_out=tuple(left_out),
        reasons=tuple(reasons.get(number, _AMBIGUOUS) for number in left_out),
        method=settings.method,
        passes=settings.passes,
    )
    return Prepared(_rounds(context, table, used, inputs), table.text(), row, _sentence(row))


_AMBIGUOUS = "the station moved between the visits to the monuments before and after it"


def _table(context: StepContext, model: ModelFile, targets: Compensable, settings: CompensationSettings) -> TableFile:
    identity = context.identity("robot")
    return table_of(
        model,
        targets.targets,
        targets.found,
        method=settings.name,
        serial=identity.serial,
        simulated=identity.simulated,
        run=context.run_name,
        created=context.calendar,
    )


def _sentence(row: TargetsRow) -> str:
    sentence = f"{row.rows} held-out poses compensated, joints by up to {row.max_correction_deg:.3f}°"
    if not row.left_out:
        return sentence
    named = [f"pose {number}: {reason}" for number, reason in zip(row.left_out, row.reasons, strict=True)]
    more = f"; {len(named) - _NAMED} more in the report" if len(named) > _NAMED else ""
    return f"{sentence}; {len(named)} left out: {'; '.join(named[:_NAMED])}{more}"


_NAMED = 3
"""So many of the targets that are left out stand in the line for the operator."""


def _rounds(
    context: StepContext, table: TableFile, rows: list[PoseRow], inputs: CompensatedRoundsInputs
) -> list[Round]:
    plans, monuments_every = _plans(context, table, rows, inputs.online), inputs.monuments_every
    first = 1 + max(each.number for each in (*context.recorded(PoseRow), *context.recorded(ReturnRow)))
    return [
        _round(context, plans[start : start + monuments_every], first + number)
        for number, start in enumerate(range(0, len(plans), monuments_every))
    ]


def _plans(context: StepContext, table: TableFile, rows: list[PoseRow], online: bool) -> list[PosePlan]:
    """The targets in the order in which they were measured before; each is reached over home, by its first approach."""
    home = _home(context)
    plans: list[PosePlan] = []
    for number, (entry, row) in enumerate(zip(table.rows, rows, strict=True), 1):
        joints = np.array(entry.nominal if online else entry.compensated)
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
    model = ModelFile.load(context.artefact("model.json"))
    return rounded(postures_of(context.cell, model.robot, "turn").home)
