"""The verdict of a campaign with stand-offs: held-out touches, stand-offs, and the state of the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace

from cellctl.procedure import StepContext
from cellctl.records import Figures, TableStateRow
from procedures.steps.sphere.rows import HeldOutFigures, SphereVerdict, StandOffFigures, StandOffRow


def verdict_of(context: StepContext) -> SphereVerdict:
    """The last verdict, including the stand-offs, if any.

    before, after: of the stand-offs. They decide the campaign's verdict: only a model that was better on held-out
    touches gets this far.
    """
    import numpy as np

    from cellctl.calibration import ErrorFigures, paired_verdict, rows_for_better

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
    tables, verdict = context.recorded(TableStateRow), paired_verdict(*errors)
    return replace(
        held_out,
        verdict=verdict,
        sentence=_sentence(verdict, standoff, rows_for_better(*errors)),
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
    from cellctl.calibration import ErrorFigures, compared_errors

    errors = [ErrorFigures(**asdict(each)) for each in (standoff.before, standoff.after)]
    figures = compared_errors(("before", "after"), errors, standoff.n)
    proof = f" A gain of this size and scatter needs at least {enough} targets: measure more." if enough else ""
    ends = {"better": "Better than nominal.", "worse": "Worse than nominal: the table was rolled back."}
    unproved = f"No better than nominal, the difference is within its own scatter: the table was rolled back.{proof}"
    end = ends.get(verdict, unproved)
    return f"Stand-off error at sphere {standoff.sphere} (not used for calibration): {figures}. {end}"
