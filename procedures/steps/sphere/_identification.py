"""From recorded touches to data set, model and verdict; the verdict of a campaign with stand-offs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration import (
    Drift,
    ErrorFigures,
    FitResult,
    Split,
    compared_errors,
    fit,
    paired_verdict,
    rows_for_better,
)
from cellctl.formats import (
    Artefact,
    DataSet,
    Measurements,
    ModelChoice,
    ModelFile,
    RobotFile,
    artefact_of,
    fit_report,
    measurements,
)
from cellctl.procedure import StepContext
from cellctl.records import Figures, TableStateRow
from cellctl.report import FitStory, identification_rows
from procedures.steps.goal import goal_figures, goal_of, unmet, with_goal
from procedures.steps.identified import Found, WrongSetup, held_out_split, provenance, wrong_setup
from procedures.steps.sphere.checked_touches import checked_words
from procedures.steps.sphere.reference_touches import drift_figures, drift_of, touch_sigma_mm
from procedures.steps.sphere.rows import (
    HeldOutFigures,
    SphereVerdict,
    StandOffFigures,
    StandOffRow,
    StopFigures,
    TouchRow,
)


def identify_touches(
    context: StepContext, model: ModelChoice, use_distances: bool, goal_mm: float = 0.0
) -> Found | WrongSetup:
    """Identify the robot from the touches, unless they show a set-up error. goal_mm: of the campaign, 0: none.

    Raises InputError if they do not allow an identification.
    """
    robot = RobotFile.load(context.robot_file)
    artefact = artefact_of(context.cell, ("artefact",))
    touches, drift = context.recorded(TouchRow), drift_of(context)
    choice = TouchModel(robot, artefact, model, use_distances)
    if wrong := wrong_setup(context, _measured(touches, choice, None), f"--artefact {context.cell.file}"):
        return wrong
    found, modelled = fitted_touches(touches, choice, drift)
    report, stops = fit_report(found.measured, found.result), _stops(robot, touches)
    goal = goal_figures(context, found.result, touch_sigma_mm(robot)) if goal_mm else None
    verdict = SphereVerdict(
        verdict=with_goal(report["verdict"], goal),
        sentence=report["sentence"] + unmet(goal),
        before=Figures(**report["nominal"]),
        after=Figures(**report["test"]),
        model={**report, **({"goal": asdict(goal)} if goal else {})},
        lines=(*([goal.sentence] if goal else []), stops.line(), _checked_words(touches, choice)),
        stops=stops,
        drift=drift_figures(drift, max(row.number for row in touches) + 1, modelled=modelled),
        noise_scale=float(found.result.identification.noise[0]),
    )
    story = FitStory.of(found.measured, found.result, found.split, report)
    data = found.data.text()
    model_file = ModelFile.of(robot, found.measured, found.result, provenance(context, data))
    return Found(data, model_file.text(), verdict, identification_rows(story))


@final
@dataclass(frozen=True, slots=True)
class TouchModel:
    """What is identified from touches: robot, artefact, model, and whether its certified distances are used."""

    robot: RobotFile
    artefact: Artefact
    model: ModelChoice
    use_distances: bool


@final
@dataclass(frozen=True, slots=True)
class FittedTouches:
    """The touches as a data set and as measurements, the held-out ones, and the fit's result."""

    data: DataSet
    measured: Measurements
    split: Split
    result: FitResult


def fitted_touches(touches: Sequence[TouchRow], choice: TouchModel, drift: Drift) -> tuple[FittedTouches, bool]:
    """The fit of the touches, corrected for a significant drift of the tip where they agree better then; whether they
    do: else it is not that of the tip.
    """
    found = _fitted(_measured(touches, choice, None))
    corrected = _fitted(_measured(touches, choice, drift)) if drift.significant else found
    modelled = corrected.result.fit.rms < found.result.fit.rms
    return (corrected if modelled else found), modelled


def _fitted(measured: Measurements) -> FittedTouches:
    """The fit of the touches that the column `set` assigns to it."""
    split = held_out_split(measured)
    return FittedTouches(measured.data, measured, split, fit(measured.task, split))


def _measured(touches: Sequence[TouchRow], choice: TouchModel, drift: Drift | None) -> Measurements:
    """The touches as measurements, with their reach corrected for `drift` if given."""
    data = DataSet.of_records([_record(row, choice.artefact, drift) for row in touches], "dataset.csv")
    return measurements(
        choice.robot,
        data,
        measure="sphere",
        model=choice.model,
        artefact=choice.artefact,
        use_distances=choice.use_distances,
    )


def _record(row: TouchRow, artefact: Artefact, drift: Drift | None) -> dict[str, Any]:
    """A recorded touch as a row of the data set; `drift`: change of the touch's reach, if any."""
    sphere = artefact.sphere(row.sphere)
    return {
        **{f"A{axis}": float(value) for axis, value in enumerate(row.joints, 1)},
        "sphere": row.sphere,
        "radius": sphere.diameter / 2.0 if sphere else None,
        "tip_radius": artefact.tip_radius,
        "set": row.set,
        "time": row.time_ns * 1e-9,
        "touch": row.number,
        **({"drift": round(float(drift.at(row.number)), 6)} if drift else {}),
        "attempt": row.attempt,
        "tick": row.tick,
        "bounces": row.bounces,
        "stop_cycles": row.stop_cycles,
    }


def _checked_words(touches: Sequence[TouchRow], choice: TouchModel) -> str:
    fit = [row for row in touches if row.set == "fit"]
    readings, spheres = np.array([row.joints for row in fit]), [row.sphere for row in fit]
    return checked_words(choice.robot, choice.artefact, spheres, readings, choice.use_distances)


def _stops(robot: RobotFile, touches: Sequence[TouchRow]) -> StopFigures:
    """The stops of the searches: the tip's travel from contact to rest, mm, by the nominal model; telegrams."""
    chain, joints = robot.chain(), robot.joint_map()
    contact = chain.forward(joints.model([row.joints for row in touches]))[:, :3, 3]
    rest = chain.forward(joints.model([row.resting for row in touches]))[:, :3, 3]
    travel = np.linalg.norm(rest - contact, axis=1)
    return StopFigures(
        overtravel_mean_mm=float(travel.mean()),
        overtravel_max_mm=float(travel.max()),
        stop_cycles_max=max(row.stop_cycles for row in touches),
        late=sum(row.late for row in touches),
        lost=sum(row.lost for row in touches),
        skipped=sum(row.skipped for row in touches),
    )


def verdict_of(context: StepContext) -> SphereVerdict:
    """The last verdict, including the stand-offs, if any.

    before, after: of the stand-offs. They decide the campaign's verdict: only a model that was better on held-out
    touches gets this far.
    """
    held_out = context.recorded(SphereVerdict)[-1]
    rows = context.recorded(StandOffRow)
    if not rows:
        return held_out
    pair = _paired(rows, "before"), _paired(rows, "after")
    errors = [np.abs([row.error_mm for row in run]) for run in pair]
    before, after = (Figures(**asdict(ErrorFigures.of(each))) for each in errors)
    standoff = StandOffFigures(
        before=before,
        after=after,
        n=len(pair[1]),
        sphere=pair[1][0].sphere,
        predicted_sigma=_rms([row.sigma_mm for row in pair[1]]),
        found_sigma=_rms([row.error_mm - row.expected_mm for row in pair[1]]),
    )
    tables, verdict, goal = context.recorded(TableStateRow), paired_verdict(*errors), goal_of(held_out)
    return replace(
        held_out,
        verdict=with_goal(verdict, goal),
        sentence=_sentence(verdict, standoff, rows_for_better(*errors)) + unmet(goal),
        lines=(held_out.sentence, *held_out.lines),
        before=before,
        after=after,
        held_out=HeldOutFigures(held_out.verdict, held_out.before, held_out.after),
        standoff=standoff,
        table=tables[-1] if tables else None,
    )


def _paired(rows: Sequence[StandOffRow], run: str) -> list[StandOffRow]:
    return sorted((row for row in rows if row.run == run), key=lambda row: row.number)


def _rms(values: Sequence[float]) -> float:
    return float((sum(value * value for value in values) / len(values)) ** 0.5)


def _sentence(verdict: str, standoff: StandOffFigures, enough: int | None) -> str:
    """enough: number of targets that would prove such a gain, if any."""
    errors = [ErrorFigures(**asdict(each)) for each in (standoff.before, standoff.after)]
    figures = compared_errors(("before", "after"), errors, standoff.n)
    proof = f" A gain of this size and scatter needs at least {enough} targets: measure more." if enough else ""
    ends = {"better": "Better than nominal.", "worse": "Worse than nominal: the table was rolled back."}
    unproved = f"No better than nominal, the difference is within its own scatter: the table was rolled back.{proof}"
    end = ends.get(verdict, unproved)
    return f"Stand-off error at sphere {standoff.sphere} (not used for calibration): {figures}. {end}"
