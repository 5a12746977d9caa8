"""The verdict of a tracker campaign: held-out poses by the model, then targets measured before and after the table."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any, final

import numpy as np

from cellctl.calibration import ErrorFigures, compared_errors, paired_verdict
from cellctl.formats import RobotFile, TableFile
from cellctl.kinematics import Bools, Floats
from cellctl.metrology import ErrorIntervals
from cellctl.procedure import StepContext
from cellctl.records import Figures, Rows, TableStateRow
from procedures.steps.goal import goal_of, unmet, with_goal
from procedures.steps.tracker.reflectors import points_of
from procedures.steps.tracker.rows import (
    ON_LINE,
    CompensatedRow,
    LeftOut,
    PoseRow,
    TargetErrorsRow,
    TargetFigures,
    TargetPlanRow,
    TargetsRow,
    TrackerVerdict,
)
from procedures.steps.tracker.station import Sessions, reflector_at


@final
@dataclass(frozen=True, eq=False)
class Targets:
    """N held-out targets measured twice. numbers (N,): of the poses; late (N,): in the late block. before, after
    (N, 3): measured less intended place, mm, in the instrument's frame of the first session. noise (N,): 1 σ (3-D) of
    the point after, without the part that all points share: the targets are in the same instrument's frame.
    """

    numbers: Floats
    late: Bools
    before: Floats
    after: Floats
    noise: Floats

    @classmethod
    def of(cls, rows: Rows) -> Targets:
        """From the rows of a run; targets that no session could be given to at either visit are left out."""
        sessions = Sessions.of(rows)
        poses = {row.number: row for row in rows.recorded(PoseRow)}
        last_fit = max((number for number, row in poses.items() if row.set == "fit"), default=0)
        found = []
        for row in sorted(rows.recorded(CompensatedRow), key=lambda each: each.number):
            ends = [sessions.place(each) for each in (poses[row.number], row)]
            if ends[0] is not None and ends[1] is not None:
                sigma = float(np.sqrt(np.trace(points_of([row.point]).alone[0])))
                found.append((row.number, row.number > last_fit, *(end - np.array(row.target) for end in ends), sigma))
        columns = list(zip(*found, strict=True)) if found else [(), (), (), (), ()]
        empty = np.zeros((0, 3))
        before, after = (np.array(column) if found else empty for column in columns[2:4])
        return cls(np.array(columns[0]), np.array(columns[1], bool), before, after, np.array(columns[4]))

    @property
    def lengths(self) -> tuple[Floats, Floats]:
        """3-D errors before and after (N,), mm."""
        return np.linalg.norm(self.before, axis=1), np.linalg.norm(self.after, axis=1)


BY_TABLE = "Compensated"


def verdict_of(context: StepContext, manner: str = BY_TABLE) -> tuple[TrackerVerdict, TargetErrorsRow | None]:
    """The last verdict, including the targets, if any, and their errors. They decide the campaign's verdict: only a
    model that was better on held-out poses gets this far. manner: how the targets were reached, as a sentence begins.
    """
    held_out = context.recorded(TrackerVerdict)[-1]
    if not context.recorded(CompensatedRow):
        return held_out, None
    targets = Targets.of(context)
    errors, sigma = targets.lengths, predicted_sigma(context, targets)
    before, after = (Figures(**asdict(ErrorFigures.of(each))) for each in errors)
    figures = TargetFigures(
        before=before,
        after=after,
        n=len(targets.numbers),
        interleaved_after=_rms(errors[1][~targets.late]),
        late_after=_rms(errors[1][targets.late]),
        predicted_sigma=None if np.isnan(sigma).any() else _rms(sigma),
        found_sigma=_rms(errors[1]),
        **_sureness(errors),
    )
    tables, verdict, made = context.recorded(TableStateRow), paired_verdict(*errors), context.recorded(TargetsRow)[-1]
    left_out, goal = (*_left_out_before(context), *_left_out(made)), goal_of(held_out)
    found = replace(
        held_out,
        verdict=with_goal(verdict, goal),
        sentence=_sentence(verdict, errors, rolled_back=manner == BY_TABLE) + unmet(goal),
        lines=(*_lines(held_out, figures, _how(manner, made), len(left_out)), *held_out.lines),
        method=made.method if manner == BY_TABLE else ON_LINE,
        left_out=left_out,
        before=before,
        after=after,
        targets=figures,
        table=tables[-1] if tables else None,
    )
    return found, _errors_row(context, targets, sigma)


def _sureness(errors: tuple[Floats, Floats]) -> dict[str, Any]:
    """The fields of `TargetFigures` that state how sure the others are; none for a single target."""
    if len(errors[0]) < 2:
        return {}
    before, after = (ErrorIntervals.of(each) for each in errors)
    return {
        "mean_95": (before.mean, after.mean),
        "rms_95": (before.rms, after.rms),
        "share_below": after.share_below,
    }


def _how(manner: str, made: TargetsRow) -> str:
    return f"{manner} by {made.manner}" if manner == BY_TABLE else manner


def _lines(held_out: TrackerVerdict, found: TargetFigures, how: str, left_out: int) -> Iterator[str]:
    """Lines below the verdict: how sure it is, by which method and model; then the model's own verdict."""
    if found.mean_95 and found.rms_95 and found.share_below:
        (_, mean), (_, rms) = found.mean_95, found.rms_95
        yield (
            f"After, 95 % intervals: mean {mean[0]:.3f} to {mean[1]:.3f} mm, RMS {rms[0]:.3f} to {rms[1]:.3f} mm; with "
            f"95 % confidence {100.0 * found.share_below:.0f} % of such targets are below the greatest error."
        )
    model = f", with the model of {held_out.model_from}" if held_out.model_from else ""
    yield f"{how}{model}."
    if left_out:
        yield f"Targets left out: {left_out}; the report names them, with the reasons."
    yield held_out.sentence


def _left_out_before(rows: Rows) -> tuple[LeftOut, ...]:
    """Targets that were left out before anything moved."""
    return tuple(each for row in rows.recorded(TargetPlanRow) for each in row.left_out)


def _left_out(made: TargetsRow) -> Iterator[LeftOut]:
    """Targets that have no row in the table."""
    for number, reason in zip(made.left_out, made.reasons, strict=False):
        yield LeftOut(target=f"pose {number}", reason=reason)


def _errors_row(context: StepContext, targets: Targets, sigma: Floats) -> TargetErrorsRow:
    rows = {row.number: row for row in context.recorded(CompensatedRow)}
    numbers = [int(number) for number in targets.numbers]
    joints = np.array([rows[number].commanded for number in numbers])
    return TargetErrorsRow(
        number=tuple(numbers),
        late=tuple(targets.late.tolist()),
        before=tuple(map(tuple, targets.before.tolist())),
        after=tuple(map(tuple, targets.after.tolist())),
        sigma=() if np.isnan(sigma).any() else tuple(sigma.tolist()),
        place=tuple(map(tuple, reflector_at(context, rows[numbers[0]].reflector, joints).tolist())),
    )


def predicted_sigma(context: StepContext, targets: Targets) -> Floats:
    """1 σ (N,), 3-D, mm, of the errors after: model, what the method leaves by the model, repeatability of the robot,
    and the measured point; NaN with a model that states none."""
    table = TableFile.load(context.artefact("table.json"))
    rows = {row.number: table.rows[row.row - 1] for row in context.recorded(CompensatedRow)}
    each = [rows[int(number)] for number in targets.numbers]
    model = np.array([row.sigma_mm for row in each], float)  # None becomes NaN
    left = np.array([row.predicted_after_mm for row in each])
    return np.asarray(np.sqrt(model**2 + left**2 + _repeatability(context) ** 2 + targets.noise**2))


def _repeatability(context: StepContext) -> float:
    return RobotFile.load(context.robot_file).repeatability


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def _sentence(verdict: str, errors: tuple[Floats, Floats], *, rolled_back: bool) -> str:
    each = [ErrorFigures.of(values) for values in errors]
    figures = compared_errors(("before", "after"), each, len(errors[0]))
    undone = ": the table was rolled back." if rolled_back else "."
    ends = {"better": "Better than nominal.", "worse": f"Worse than nominal{undone}"}
    end = ends.get(verdict, f"No better than nominal{undone}")
    return f"Position error at held-out targets (not used for calibration): {figures}. {end}"
