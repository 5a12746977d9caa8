"""Stand-offs from the located sphere: targets, compensated joints, table, predictions, and their measured distances."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration import LocatedSphere, RobotModel, locate_sphere
from cellctl.compensation import Compensated
from cellctl.files import InputError
from cellctl.formats import ModelFile, TableFile, artefact_of, compensated_targets, nominal_chain, table_of
from cellctl.kinematics import Floats, JointMap
from cellctl.planning import PlannedTouch, TouchOptions
from cellctl.procedure import StepContext
from procedures.steps.contact_search import FoundContact
from procedures.steps.sphere.plan_inputs import CompensateInputs
from procedures.steps.sphere.planning import BEYOND_MM, as_plan, as_touch, standoff_lines, standoff_options
from procedures.steps.sphere.reference_touches import drift_of, last_number, touch_sigma_mm
from procedures.steps.sphere.rows import LocateRow, ProofRow, ReferenceRow, SphereVerdict, StandOffRow, TouchRow
from procedures.steps.sphere.touch_plans import Round, StandOffPlan, TouchPlan

_TOLERANCE_MM = 1e-4
"""Left by the compensated joints, far below a touch's scatter: as in older runs, which replay to the same bytes."""

_CLEAR_MM = 1.0
"""Least predicted distance, mm, of a line's start from the surface, and of its end below it: many times the 1 σ of a
prediction. With less a robot could touch in its transfer, or find nothing."""

_LONGER_MM = 8.0
"""Most, mm, by which a line is longer at either end. A robot that is farther off has wrong link lengths or base."""


@final
@dataclass(frozen=True, slots=True)
class Prepared:
    """The stand-offs in rounds, the text of the table file, the row to record, and a line for the operator."""

    rounds: list[Round]
    table: str
    row: ProofRow
    sentence: str


@final
@dataclass(frozen=True, eq=False)
class _Sphere:
    """The proof sphere located by either model. reach: distance tip centre – sphere centre at contact, mm."""

    nominal: LocatedSphere
    identified: LocatedSphere
    reach: float


def standoffs_and_table(context: StepContext, inputs: CompensateInputs) -> Prepared:
    """Locate the sphere by either model, plan targets off it, compensate them, make the table.

    Before: nominal joints to targets about the centre by the nominal model. After: compensated joints to the
    same targets about the identified centre. Raises InputError if targets cannot be reached.
    """
    model = ModelFile.load(context.artefact("model.json"))
    sphere = _located(context, model, inputs.sphere)
    x, y, z = sphere.nominal.centre.tolist()
    half = inputs.reference_every // 2  # each target is two stand-offs
    again = as_touch(inputs.reference)

    def planned(options: TouchOptions) -> list[PlannedTouch]:
        return standoff_lines(context, inputs.sphere, (x, y, z), inputs.targets, options, half, again)

    lines, off_mm = _lines_that_reach(context, model, sphere, inputs.distance_mm, planned)
    targets = [line for line in lines if not line.reference]
    found, inside = _compensated(context, model, sphere, targets)
    table = _table(context, model, sphere, targets, found)
    first = 1 + last_number(context, TouchRow, ReferenceRow, LocateRow)
    drifted = _drifted(context, first + 2.0 * np.arange(len(targets)))
    pairs = _pairs(model, sphere, off_mm, targets, found, inside, drifted)
    rounds = _rounds(lines, pairs, inputs.reference, first)
    sentence = _sentence(inputs.sphere, sphere, table)
    if targets[0].search_mm > inputs.distance_mm + BEYOND_MM + 0.5:
        sentence += f"; search lines of {targets[0].search_mm:.0f} mm, because the nominal robot is far off"
    return Prepared(rounds, table.text(), _row(inputs.sphere, sphere, table), sentence)


def _lines_that_reach(
    context: StepContext,
    model: ModelFile,
    sphere: _Sphere,
    distance_mm: float,
    planned: Callable[[TouchOptions], list[PlannedTouch]],
) -> tuple[list[PlannedTouch], float]:
    """Lines that begin off the surface and end below it by the identified model too; the distance of their targets, mm.

    They are from `distance_mm` off to `BEYOND_MM` below, and longer at either end where the nominal robot is farther
    off than that. Raises InputError where it is too far off.
    """
    off_mm, below_mm = distance_mm, BEYOND_MM
    while max(off_mm - distance_mm, below_mm - BEYOND_MM) <= _LONGER_MM:
        lines = planned(standoff_options(off_mm, below_mm))
        targets = [line for line in lines if not line.reference]
        starts, ends = (
            sphere.identified.distances(model.robot.joint_map().model(np.array(readings))) - sphere.reach
            for readings in ([line.start for line in targets], [line.end for line in targets])
        )
        too_near, too_high = _CLEAR_MM - starts.min(), ends.max() + _CLEAR_MM
        if max(too_near, too_high) <= 0.0:
            return lines, off_mm
        off_mm, below_mm = off_mm + max(0, math.ceil(too_near)), below_mm + max(0, math.ceil(too_high))
    what = (
        f"the nominal robot is too far off at the proof sphere: its stand-offs would have to begin {off_mm:.0f} mm off "
        f"the surface and end {below_mm:.0f} mm below it"
    )
    cure = "start from better link lengths, such as the maker's calibration of this arm, or move the proof sphere"
    raise InputError(context.cell.problem(("artefact", "spheres"), what, cure))


def _located(context: StepContext, model: ModelFile, name: str) -> _Sphere:
    artefact = artefact_of(context.cell, ("artefact",))
    sphere = artefact.sphere(name)
    assert sphere is not None
    reach = sphere.diameter / 2.0 + artefact.tip_radius
    rows = context.recorded(LocateRow)
    q = model.robot.joint_map().model([row.joints for row in rows])
    sigma = touch_sigma_mm(model.robot) * context.recorded(SphereVerdict)[-1].noise_scale
    reaches = reach + _drifted(context, [row.number for row in rows])
    identified = locate_sphere(model.robot_model(), q, reaches, sigma)
    nominal = locate_sphere(RobotModel(nominal_chain(model)), q, reaches, sigma)
    # With few touches a nominal robot's errors may fit a sphere on their other side better: another one, far away.
    if np.linalg.norm(nominal.centre - identified.centre) > reach / 2.0:
        nominal = locate_sphere(nominal.model, q, reaches, sigma, near=identified.centre)
    return _Sphere(nominal, identified, reach)


def _drifted(context: StepContext, numbers: ArrayLike) -> Floats:
    """Change of the tip's reach at touch `numbers` (N,), mm; 0 unless the fit modelled it."""
    drift = context.recorded(SphereVerdict)[-1].drift
    return drift_of(context).at(numbers) if drift.modelled else np.zeros(np.shape(numbers))


def _compensated(
    context: StepContext, model: ModelFile, sphere: _Sphere, lines: list[PlannedTouch]
) -> tuple[Compensated, Compensated]:
    """Compensated joints for the targets, and for the ends of the searches from them."""
    both = [
        compensated_targets(model, _about_identified(model, sphere, readings), readings, tolerance_mm=_TOLERANCE_MM)
        for readings in (np.array([line.start for line in lines]), np.array([line.end for line in lines]))
    ]
    missed = [str(row + 1) for row in np.flatnonzero(~(both[0].converged & both[1].converged))]
    if missed:
        what = f"stand-off targets {', '.join(missed)} are out of the identified robot's reach"
        raise InputError(context.cell.problem(("artefact", "spheres"), what, "move the proof sphere"))
    return both[0], both[1]


def _about_identified(model: ModelFile, sphere: _Sphere, readings: Floats) -> Floats:
    """Poses (N, 4, 4) relative to the identified centre, like the nominal ones at `readings` (N, n), deg, to theirs."""
    poses = nominal_chain(model).forward(model.robot.joint_map().model(readings))
    poses[:, :3, 3] += sphere.identified.centre - sphere.nominal.centre
    return np.asarray(poses)


def _table(
    context: StepContext,
    model: ModelFile,
    sphere: _Sphere,
    lines: list[PlannedTouch],
    found: Compensated,
) -> TableFile:
    identity = context.identity("robot")
    return table_of(
        model,
        _about_identified(model, sphere, np.array([line.start for line in lines])),
        found,
        serial=identity.serial,
        simulated=identity.simulated,
        run=context.run_name,
        created=context.calendar,
    )


def _pairs(
    model: ModelFile,
    sphere: _Sphere,
    distance_mm: float,
    lines: list[PlannedTouch],
    found: Compensated,
    inside: Compensated,
    drifted: Floats,
) -> list[list[StandOffPlan]]:
    """For each target the stand-off before and the one after, which starts at the first one's end.

    The targets are for the tip at the first touch; its drift `drifted` (N,), mm, is in the prediction.
    """
    joints = model.robot.joint_map()
    before = np.array([line.start for line in lines])
    nominal, after, ends = (
        joints.readings(q).round(6) for q in (found.nominal_q, found.compensated_q, inside.compensated_q)
    )
    normals = sphere.nominal.normals(joints.model(before))
    predicted = [_predicted(model, sphere, readings, distance_mm + drifted) for readings in (before, after)]
    pairs = []
    for number, line in enumerate(lines):
        common = {
            "number": number,
            "sphere": line.sphere,
            "search_mm": line.search_mm,
            "normal": normals[number].tolist(),
            "distance_mm": distance_mm,
        }
        first = StandOffPlan(
            run="before",
            row=None,
            origin=list(line.origin),
            approach=[list(q) for q in line.approach],
            nominal=list(line.start),
            commanded=list(line.start),
            end=list(line.end),
            retreat=[list(line.start)],
            expected_mm=float(predicted[0][0][number]),
            sigma_mm=float(predicted[0][1][number]),
            **common,
        )
        second = StandOffPlan(
            run="after",
            row=number + 1,
            origin=list(line.start),
            approach=[],
            nominal=nominal[number].tolist(),
            commanded=after[number].tolist(),
            end=ends[number].tolist(),
            retreat=[after[number].tolist(), *(list(q) for q in line.retreat[1:])],
            expected_mm=float(predicted[1][0][number]),
            sigma_mm=float(predicted[1][1][number]),
            **common,
        )
        pairs.append([first, second])
    return pairs


def _predicted(model: ModelFile, sphere: _Sphere, readings: Floats, distance_mm: Floats) -> tuple[Floats, Floats]:
    """The error of a move to `readings` (N, n), deg, predicted by the identified model (N,), and its 1 σ (N,), mm."""
    q = model.robot.joint_map().model(readings)
    expected = sphere.identified.distances(q) - sphere.reach - distance_mm
    return expected, sphere.identified.sigma_of_stand_off(np.array(model.covariance), q)


def _rounds(
    lines: list[PlannedTouch], pairs: list[list[StandOffPlan]], reference: TouchPlan, number: int
) -> list[Round]:
    """The pairs, split at the returns to the reference touch; `number`: the first return's."""
    rounds: list[Round] = []
    left, standoffs = iter(pairs), list[StandOffPlan]()
    for line in lines:
        if not line.reference:
            standoffs += next(left)
            number += 2
            continue
        again = as_plan(number, line, "reference", reference.number)
        rounds.append(Round(standoffs=standoffs, references=[again]))
        standoffs, number = [], number + 1
    return [*rounds, Round(standoffs=standoffs, references=[])] if standoffs else rounds


def _row(name: str, sphere: _Sphere, table: TableFile) -> ProofRow:
    return ProofRow(
        sphere=name,
        nominal_centre=tuple(sphere.nominal.centre.tolist()),
        identified_centre=tuple(sphere.identified.centre.tolist()),
        nominal_residuals=tuple(sphere.nominal.residuals.tolist()),
        identified_residuals=tuple(sphere.identified.residuals.tolist()),
        table=table.id,
        rows=len(table.rows),
        created=table.created,
        max_correction_deg=table.max_correction_deg,
    )


def _sentence(name: str, sphere: _Sphere, table: TableFile) -> str:
    before, after = (float(np.abs(found.residuals).mean()) for found in (sphere.nominal, sphere.identified))
    return (
        f"{name} located by {len(sphere.nominal.residuals)} touches (residuals {before:.3f} → {after:.3f} mm mean); "
        f"{len(table.rows)} targets compensated, joints by up to {table.max_correction_deg:.3f}°"
    )


def standoff_row(context: StepContext, target: StandOffPlan, found: FoundContact) -> StandOffRow:
    """The row that a stand-off records."""
    joints, models = _models(context.artefact("model.json"))
    tips = models[target.run].tcp(joints.model([found.start, found.joints]))
    travel = float((tips[0] - tips[1]) @ np.array(target.normal))
    return StandOffRow(
        number=target.number,
        run=target.run,
        row=target.row,
        sphere=target.sphere,
        nominal=tuple(target.nominal),
        commanded=tuple(target.commanded),
        at_target=tuple(found.start),
        at_contact=tuple(round(value, 6) for value in found.joints),
        normal=tuple(target.normal),
        travel_mm=travel,
        error_mm=travel - target.distance_mm,
        expected_mm=target.expected_mm,
        sigma_mm=target.sigma_mm,
        attempt=context.attempt,
        **found.row(),
    )


@lru_cache(maxsize=1)
def _models(file: Path) -> tuple[JointMap, dict[str, RobotModel]]:
    """Joint map, nominal and identified robot of a run's model, which is constant once written."""
    model = ModelFile.load(file)
    return model.robot.joint_map(), {"before": RobotModel(nominal_chain(model)), "after": model.robot_model()}
