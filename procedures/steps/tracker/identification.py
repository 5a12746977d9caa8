"""From recorded poses to data set, model and verdict."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from cellctl.calibration import FitResult, fit
from cellctl.devices import MeasuredPoint
from cellctl.files import InputError
from cellctl.formats import DataSet, Measurements, ModelFile, RobotFile, fit_report, measurements
from cellctl.formats.measurements import Kind, ModelChoice
from cellctl.procedure import StepContext
from cellctl.records import Figures
from procedures.steps.identified import Found, held_out_split, provenance
from procedures.steps.setup_errors import WrongSetup, wrong_setup
from procedures.steps.tracker.places import measured_place, measured_pose
from procedures.steps.tracker.plate import plate_of
from procedures.steps.tracker.rows import HeldOutFigures, PoseRow, SetUpRow, TrackerVerdict
from procedures.steps.tracker.sessions import Sessions
from procedures.steps.tracker.six_dimensions import six_row


def identify_poses(context: StepContext, model: ModelChoice) -> Found | WrongSetup:
    """Identify the robot from the poses, unless they show a set-up error.

    Poses that were measured while the station moved belong to no session and are left out. Raises InputError if the
    rest does not allow an identification.
    """
    from cellctl.report.fit import FitStory, identification_rows  # imports much: not on the engine's loop

    robot = RobotFile.load(context.robot_file)
    data, ambiguous = pose_data(context)
    measure: Kind = "pose" if data.has("QW") else "position"
    measured = measurements(robot, data, measure=measure, model=model)
    if wrong := wrong_setup(context, measured, f"--measure {measure}"):
        return wrong
    split = held_out_split(measured)
    result = fit(measured.task, split)
    report = fit_report(measured, result)
    story = FitStory.of(measured, result, split, report)
    file = ModelFile.of(robot, measured, result, provenance(context, data.text()))
    six = [six_row(measured, result, split)] if measure == "pose" else []
    rows = (*identification_rows(story), *six)
    return Found(data.text(), file.text(), fit_verdict(context, measured, result, report, ambiguous), rows)


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


def pose_data(context: StepContext) -> tuple[DataSet, int]:
    """The poses as a data set, and how many were left out for lack of a session. Raises InputError if none is left."""
    sessions, payload_kg = Sessions.of(context), context.recorded(SetUpRow)[-1].payload_kg
    repeatability = RobotFile.load(context.robot_file).repeatability
    rows = [(row, sessions.session(row.visit)) for row in context.recorded(PoseRow)]
    plate = plate_of(context)
    places = measured_place if plate is None else partial(measured_pose, plate)
    records = [_record(row, session, payload_kg, places(row, repeatability)) for row, session in rows if session]
    if not records:
        what = "no pose has a session: the station moved in every round"
        raise InputError(context.cell.problem(("station",), what, "stand the instrument firmly, then begin anew"))
    return DataSet.of_records(records, "dataset.csv"), len(rows) - len(records)


def _record(row: PoseRow, session: str, payload_kg: float, place: dict[str, float]) -> dict[str, Any]:
    """A pose as a row of the data set; joints in degrees. place: the columns of what was measured."""
    return {
        **_numbered("A", row.joints),
        **place,
        **_numbered("D", row.direction),
        **({"temperature": row.arm_c} if row.arm_c is not None else {}),
        **({"payload": payload_kg} if payload_kg else {}),
        **(_numbered("I", row.currents.amperes) if row.currents else {}),
        "session": session,
        "set": row.set,
        "time": row.point.time_ns * 1e-9,
        "pose": row.number,
        "samples": row.point.samples,
        "attempt": row.attempt,
    }


def _numbered(letter: str, values: Sequence[float]) -> dict[str, float]:
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
