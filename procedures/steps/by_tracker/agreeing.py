"""Spheres and tracker calibrate one robot, each by itself; whether both agree by their own covariances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, final

from cellctl.calibration import Agreement, FitResult, fit
from cellctl.formats import ModelFile, RobotFile, fit_report, measurements
from cellctl.operations.campaign_services import models_agree
from cellctl.procedure import NoInputs, StepContext, step
from cellctl.records import Figures, Json, VerdictRow
from cellctl.report import agreement_lines
from procedures.steps.identified import held_out_split, provenance
from procedures.steps.judged import Judged
from procedures.steps.sphere.rows import SphereVerdict
from procedures.steps.tracker.identification import pose_data
from procedures.steps.tracker.rows import PoseRow


@final
@dataclass(frozen=True, kw_only=True)
class CrossCheckVerdict(VerdictRow):
    """Whether spheres (a) and tracker (b) agree: `agree`, `disagree` or `not known`. before, after: nominal and the
    tracker's own model at held-out poses. tracker: report of the fit of the poses; accuracy, noise_only: of the
    instrument.
    """

    SECTION: ClassVar[tuple[str, ...]] = ("agreement", "tracker", "accuracy", "noise_only")
    agreement: Agreement | None = None
    tracker: Mapping[str, Json] | None = None
    accuracy: str = ""
    noise_only: bool = False


@step("by_tracker.cross_check", verdict=CrossCheckVerdict)
async def cross_check(context: StepContext, inputs: NoInputs) -> Judged:
    """Identify the robot from the poses too, and state whether the two calibrations agree."""
    found = await context.clock.compute(checked, context)
    await context.write_artefact("tracker.csv", found.data)
    await context.write_artefact("tracker_model.json", found.model)
    await context.record(found.verdict)
    return Judged.of(found.verdict)


@final
@dataclass(frozen=True)
class Checked:
    """The texts of the poses' data set and of the model from them, and the verdict."""

    data: str
    model: str
    verdict: CrossCheckVerdict


def checked(context: StepContext) -> Checked:
    """The calibration by the poses, compared with that by the touches. Raises InputError."""
    robot = RobotFile.load(context.robot_file)
    data, left_out = pose_data(context)
    measured = measurements(robot, data, measure="position")
    result = fit(measured.task, held_out_split(measured))
    tracker = ModelFile.of(robot, measured, result, provenance(context, data.text()))
    touched = context.recorded(SphereVerdict)[-1]
    agreed, why = _agreement(ModelFile.load(context.artefact("model.json")), tracker)
    verdict: str
    verdict, sentence = "not known", f"Whether the calibrations agree is not known: {why}."
    if agreed:
        verdict, sentence = agreed.verdict, agreed.sentence
    point, report = context.recorded(PoseRow)[0].point, fit_report(measured, result)
    lines = agreement_lines(agreed) if agreed else []
    if verdict == "disagree" and (unsound := _unsound(touched, result)):
        lines.append(f"σ does not hold on the held-out rows of {unsound}: it may be σ that is wrong, not the method.")
    lines += [f"Spheres: {touched.sentence}", f"Tracker: {report['sentence']}"]
    if touched.noise_scale > 1.0:
        lines.append(f"The touches are {touched.noise_scale:.1f} times as noisy as stated; every σ contains it.")
    if left_out:
        lines.append(f"{left_out} poses were measured while the station moved; they were left out.")
    return Checked(
        data=data.text(),
        model=tracker.text(),
        verdict=CrossCheckVerdict(
            verdict=verdict,
            sentence=sentence,
            before=Figures(**report["nominal"]),
            after=Figures(**report["test"]),
            model=touched.model,
            lines=tuple(lines),
            agreement=agreed,
            tracker=report,
            accuracy=point.accuracy,
            noise_only=point.noise_only,
        ),
    )


def _agreement(touches: ModelFile, tracker: ModelFile) -> tuple[Agreement | None, str]:
    try:
        return models_agree(touches, tracker), ""
    except ValueError as error:
        return None, str(error)


def _unsound(touched: SphereVerdict, tracker: FitResult) -> str:
    """Which of both fits predicts its own held-out rows wrongly; empty: none."""
    of_touches = (touched.model or {}).get("sigma_ok")
    return " and ".join(
        name for name, ok in (("the spheres", of_touches), ("the tracker", tracker.sigma_ok)) if ok is False
    )
