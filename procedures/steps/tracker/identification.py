"""From recorded poses to data set, model and verdict; an earlier run's model registered to this instrument."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from cellctl.calibration import OBSERVABLE_SIGMAS, FitResult, Split, State, fit
from cellctl.devices import MeasuredPoint
from cellctl.files import InputError, Problem, sha256_of
from cellctl.formats import (
    DataSet,
    Kind,
    Measurements,
    ModelChoice,
    ModelFile,
    RobotFile,
    fit_report,
    from_prior,
    measurements,
)
from cellctl.kinematics import Floats, inverse_pose
from cellctl.procedure import StepContext
from cellctl.records import Figures
from cellctl.report import FitStory, identification_rows
from procedures.steps.goal import goal_figures, unmet, with_goal
from procedures.steps.identified import Found, WrongSetup, held_out_split, provenance, wrong_setup
from procedures.steps.tracker.reflectors import measured_place, measured_pose, plate_of
from procedures.steps.tracker.rows import (
    MODEL_FILE,
    HeldOutFigures,
    PoseRow,
    ReadModelRow,
    SetUpRow,
    SixFigures,
    SixRow,
    TrackerVerdict,
)
from procedures.steps.tracker.station import Sessions

Indices: TypeAlias = NDArray[np.intp]


def six_row(measured: Measurements, result: FitResult, split: Split) -> SixRow:
    """The row of a fit from poses."""
    held_out = np.array([of == "test" for of in measured.sets])
    left_out = np.zeros(len(held_out), bool)
    left_out[list(result.identification.outliers)] = True
    names, r = pivots(result)
    return SixRow(
        fit=_figures(measured, result, np.flatnonzero(~held_out & ~left_out)),
        test=_figures(measured, result, np.flatnonzero(held_out)),
        parameters=names,
        r=r,
        observable=OBSERVABLE_SIGMAS,
    )


def pivots(result: FitResult) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Names and |R_ii| of the free parameters by column-pivoted QR of the Jacobian, in σ of the rows per prior σ."""
    found = result.identification.identified
    free = np.flatnonzero(found.unknowns.free)
    _, triangle, order = scipy.linalg.qr(found.triangle, mode="economic", pivoting=True)
    names = tuple(found.unknowns.parameters[free[at]].name for at in order)
    return names, tuple(np.abs(np.diag(triangle)).tolist())


def _figures(measured: Measurements, result: FitResult, which: Indices) -> SixFigures:
    states = result.identification.nominal.state, result.identification.identified.state
    (before, angle_before), (after, angle_after) = (_means(measured, state, which) for state in states)
    return SixFigures(n=len(which), before=before, after=after, angle_before=angle_before, angle_after=angle_after)


def _means(measured: Measurements, state: State, which: Indices) -> tuple[tuple[float, ...], float]:
    rows = measured.task.rows.pick(which)
    blocks = [block for block in rows.blocks if block.orientations is not None and len(block)]
    if not blocks:
        return (0.0, 0.0, 0.0), 0.0
    six = np.concatenate([block.deviation(state) for block in blocks])
    angle = np.degrees(np.linalg.norm(six[:, 3:], axis=1)).mean()
    return tuple(np.abs(six[:, :3]).mean(axis=0).tolist()), float(angle)


def identify_poses(context: StepContext, model: ModelChoice, goal_mm: float = 0.0) -> Found | WrongSetup:
    """Identify the robot from the poses, unless they show a set-up error. goal_mm: of the campaign, 0: none.

    Poses that were measured while the station moved belong to no session and are left out. Raises InputError if the
    rest does not allow an identification.
    """
    robot = RobotFile.load(context.robot_file)
    data, ambiguous = pose_data(context)
    measure = kind_of(data)
    measured = measurements(robot, data, measure=measure, model=model)
    if wrong := wrong_setup(context, measured, f"--measure {measure}"):
        return wrong
    split = held_out_split(measured)
    result = fit(measured.task, split)
    report = fit_report(measured, result)
    story = FitStory.of(measured, result, split, report)
    file = ModelFile.of(measured.robot, measured, result, provenance(context, data.text()))
    six = [six_row(measured, result, split)] if measure == "pose" else []
    rows = (*identification_rows(story), *six)
    verdict = fit_verdict(context, measured, result, report, ambiguous)
    if goal_mm and (goal := goal_figures(context, result, _axis_sigma_mm(measured), axes=3)):
        verdict = replace(
            verdict,
            verdict=with_goal(verdict.verdict, goal),
            sentence=verdict.sentence + unmet(goal),
            lines=(goal.sentence, *verdict.lines),
            model={**report, "goal": asdict(goal)},
        )
    return Found(data.text(), file.text(), verdict, rows)


def _axis_sigma_mm(measured: Measurements) -> float:
    """Stated 1 σ of a measured place along an axis, RMS."""
    sigma = np.concatenate([block.sigma[:, :3] for block in measured.task.rows.blocks])
    return float(np.sqrt(np.mean(sigma**2)))


def fit_verdict(
    context: StepContext, measured: Measurements, result: FitResult, report: dict[str, Any], ambiguous: int
) -> TrackerVerdict:
    """The verdict of held-out poses on the model; ambiguous: poses without a session."""
    setup, points = context.recorded(SetUpRow)[-1], [row.point for row in context.recorded(PoseRow)]
    return TrackerVerdict(
        verdict=report["verdict"],
        sentence=report["sentence"],
        before=Figures(**report["nominal"]),
        after=Figures(**report["test"]),
        model=report,
        lines=tuple(_lines(setup, points, ambiguous)),
        accuracy=points[0].accuracy,
        noise_only=points[0].noise_only,
        noise_scale=float(result.identification.noise[0]),
        sessions=tuple(dict.fromkeys(measured.texts("session"))),
        ambiguous=ambiguous,
        load=setup.load,
        held_out=HeldOutFigures(
            verdict=report["verdict"],
            before=Figures(**report["nominal"]),
            after=Figures(**report["test"]),
            predicted=report["predicted_test_rms"],
        ),
    )


def kind_of(data: DataSet) -> Kind:
    """What the instrument measured of each pose."""
    return "pose" if data.has("QW") else "position"


def pose_data(context: StepContext) -> tuple[DataSet, int]:
    """The poses as a data set, and how many were left out for lack of a session. Raises InputError if none is left."""
    rows = context.recorded(PoseRow)
    records = pose_records(context, rows)
    return DataSet.of_records(records, "dataset.csv"), len(rows) - len(records)


def pose_records(context: StepContext, poses: Sequence[PoseRow]) -> list[dict[str, Any]]:
    """The rows of the data set, of those poses that have a session. Raises InputError if none has."""
    sessions, payload_kg = Sessions.of(context), context.recorded(SetUpRow)[-1].payload_kg
    repeatability = RobotFile.load(context.robot_file).repeatability
    rows = [(row, sessions.session(row.visit)) for row in poses]
    plate = plate_of(context)
    places = measured_place if plate is None else partial(measured_pose, plate)
    records = [_record(row, session, payload_kg, places(row, repeatability)) for row, session in rows if session]
    if not records:
        what = "no pose has a session: the station moved in every round"
        raise InputError(context.cell.problem(("station",), what, "stand the instrument firmly, then begin anew"))
    return records


def _record(row: PoseRow, session: str, payload_kg: float, place: dict[str, float]) -> dict[str, Any]:
    """A pose as a row of the data set; joints in degrees. place: the columns of what was measured."""
    return {
        **numbered("A", row.joints),
        **place,
        **numbered("D", row.direction),
        **({"temperature": row.arm_c} if row.arm_c is not None else {}),
        **({"payload": payload_kg} if payload_kg else {}),
        **(numbered("I", row.currents.amperes) if row.currents else {}),
        "session": session,
        "set": row.set,
        "time": row.point.time_ns * 1e-9,
        "pose": row.number,
        "samples": row.point.samples,
        "attempt": row.attempt,
    }


def numbered(letter: str, values: Sequence[float]) -> dict[str, float]:
    """Columns of the data set, one for each axis."""
    return {f"{letter}{axis}": float(value) for axis, value in enumerate(values, 1)}


def _lines(setup: SetUpRow, points: Sequence[MeasuredPoint], ambiguous: int) -> list[str]:
    """Lines below the verdict: what it depends on."""
    accuracy, common = points[0].accuracy, np.mean([np.trace(np.array(point.common)) for point in points]) ** 0.5
    lines = [f"Instrument: accuracy profile {accuracy}; load: {setup.load}, {setup.payload_kg:g} kg."]
    if points[0].noise_only:
        lines[0] += " The profile is the noise of such an instrument only, not its behaviour."
    lines.append(
        f"Not in σ: {common:.2f} mm (1 σ) in every point alike, by the instrument's range zero and scale, refraction "
        "and centring. They change the robot's size; this instrument alone cannot show that."
    )
    if ambiguous:
        lines.append(f"{ambiguous} poses were measured while the station moved; they were left out.")
    return lines


_NOISE_SCALE = 4.0
"""From this noise scale on the model that was read is taken for that of another state of the robot."""


def registered_model(context: StepContext) -> Found:
    """The model that was read, in the instrument's frame of this run, and its verdict on the held-out poses.

    Only the base is found anew, from the poses of the set `fit`: the robot is as it was identified. Raises InputError
    if the poses scatter about the model far more than its σ and the instrument's allow.
    """
    robot, read = RobotFile.load(context.robot_file), context.recorded(ReadModelRow)[-1]
    prior = ModelFile.load(context.artefact(MODEL_FILE))
    data, ambiguous = pose_data(context)
    measured = from_prior(measurements(robot, data, measure="position"), prior, ("base",), read.run)
    split = held_out_split(measured)
    result = fit(measured.task, split)
    _refuse_another_state(context, read, float(result.identification.noise[0]))
    report = fit_report(measured, result)
    source = {**provenance(context, data.text()), "prior_sha256": sha256_of(read.text), "prior_run": read.run}
    base = result.identification.identified.state.model.chain.base_now
    file = _moved(ModelFile.of(robot, measured, result, source, prior), prior, base)
    verdict = fit_verdict(context, measured, result, report, ambiguous)
    rows = tuple(identification_rows(FitStory.of(measured, result, split, report)))
    return Found(data.text(), file.text(), replace(verdict, model_from=read.run), rows)


def _refuse_another_state(context: StepContext, read: ReadModelRow, noise_scale: float) -> None:
    if noise_scale < _NOISE_SCALE:
        return
    what = (
        f"the poses scatter about the model of {read.run} {noise_scale:.0f} times more than its σ and the instrument's "
        "allow: robot, tool, load or reflector is not as it was when it was identified; no table was pushed"
    )
    cure = "identify the robot as it is now: run the procedure without a model, or `cellctl run tracker_calibration`"
    raise InputError(Problem(str(context.run_folder / MODEL_FILE), 0, 0, what, cure))


def _moved(found: ModelFile, prior: ModelFile, base: Floats) -> ModelFile:
    """`prior` moved as a whole, so that its base is at `base` (4, 4), with the covariance `found`.

    The nominal robot moves too: a target stays where the nominal robot was when the model was identified.
    """
    motion = base @ inverse_pose(prior.robot_model().chain.base_now)
    values = {parameter.name: parameter.value for parameter in prior.parameters}
    return found.model_copy(
        update={
            "start": {"base": (motion @ np.array(prior.start["base"])).tolist(), "tool": prior.start["tool"]},
            "parameters": [each.model_copy(update={"value": values[each.name]}) for each in found.parameters],
            "sessions": [],
            "model": prior.model,
        }
    )
