"""The held-out targets before and after the table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cellctl.report import ReportSection, Run, Sigma
from cellctl.report.drawing import before_and_after
from cellctl.report.figures import error_line, fixed, percent, significant
from procedures.reports.tracker.pictures import arrows_picture, bars_picture
from procedures.steps.tracker.rows import ON_LINE, TargetErrorsRow, TargetFigures, TargetsRow, TrackerVerdict


def build(run: Run) -> Mapping[str, Any] | None:
    """Pictures, and found against predicted errors."""
    row, verdict = run.state.last(TargetErrorsRow), run.state.last(TrackerVerdict)
    if row is None or verdict is None or verdict.targets is None:
        return None
    before, after, late = np.array(row.before), np.array(row.after), np.array(row.late)
    lengths = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    return {
        "sentences": list(_sentences(verdict, verdict.targets, run.state.last(TargetsRow))),
        "intervals": list(_intervals(verdict.targets)),
        "share_below": percent(verdict.targets.share_below) if verdict.targets.share_below else "",
        "left_out": [str(each) for each in verdict.left_out],
        "distribution": before_and_after("targets", *lengths, "position error"),
        "bars": bars_picture(row.number, *lengths, np.array(row.sigma), late),
        "arrows": arrows_picture(np.array(row.place), before, after),
    }


def _sentences(verdict: TrackerVerdict, found: TargetFigures, made: TargetsRow | None) -> Iterator[str]:
    yield "No held-out pose was used for the identification. Its target is where the registered nominal robot would be."
    if verdict.model_from:
        yield f"The model is that of {verdict.model_from}, registered to the instrument by poses that are not judged."
    on_line = verdict.method == ON_LINE
    after = "the same joints, corrected on-line" if on_line else "the same target by the controller's table"
    yield f"Before: nominal joints. After: {after}. Errors are 3-D."
    ratio = significant(found.found_sigma / found.predicted_sigma) if found.predicted_sigma else "–"
    yield (
        f"After: found {significant(found.found_sigma)} mm RMS where {significant(found.predicted_sigma)} mm was "
        f"predicted (ratio {ratio}); {significant(found.interleaved_after)} mm of targets interleaved with the fit, "
        f"{significant(found.late_after)} mm of the late block."
    )
    if made and not on_line:
        yield f"Method: {made.manner}. Joints are corrected by up to {made.max_correction_deg:.3f}°."
    if verdict.noise_only:
        yield f"The instrument's accuracy {verdict.accuracy} is a profile of noise only, not of its behaviour."


def _intervals(found: TargetFigures) -> Iterator[tuple[str, ...]]:
    """Lines of the table: name, mean and RMS with their 95 % intervals, maximum; mm."""
    if not found.mean_95 or not found.rms_95:
        return
    ends = (("before", found.before), ("after", found.after))
    for (name, figures), mean, rms in zip(ends, found.mean_95, found.rms_95, strict=True):
        yield name, *(fixed(figures.mean), _range(mean), fixed(figures.rms), _range(rms), fixed(figures.max))


def _range(ends: tuple[float, float]) -> str:
    return f"{fixed(ends[0])} … {fixed(ends[1])}"


def error_lines(run: Run) -> Sequence[Mapping[str, Any]]:
    """Targets before and after, from the verdict."""
    verdict = run.state.last(TrackerVerdict)
    found = verdict.targets if verdict else None
    if found is None or not found.n:
        return []
    return [error_line("held-out targets", found.n, vars(found.before), vars(found.after), found.predicted_sigma)]


SECTION = ReportSection(
    id="tracker-targets",
    title="Proof by held-out targets",
    order=20,
    needs=(TargetErrorsRow,),
    build=build,
    error_lines=error_lines,
    sigmas=(
        Sigma(
            "predicted 1 σ after",
            "the error at one target with the table in force",
            "covariance of the parameters, repeatability of the robot, and the measured point without its common part",
            "1 σ, 3-D",
        ),
    ),
    template="""\
<p>{{ sentences | join(" ") }}</p>
{% if intervals %}
<table>
<thead><tr><th></th><th>mean, mm</th><th>95 %</th><th>RMS, mm</th><th>95 %</th><th>max, mm</th></tr></thead>
<tbody>
{% for name, mean, of_mean, rms, of_rms, most in intervals %}
<tr><th>{{ name }}</th><td>{{ mean }}</td><td>{{ of_mean }}</td><td>{{ rms }}</td><td>{{ of_rms }}</td>
<td>{{ most }}</td></tr>
{% endfor %}
</tbody>
</table>
<p class="note">Intervals of mean and RMS from the scatter of the errors, as of targets drawn at random. With 95 %
confidence {{ share_below }} of such targets are below the greatest error after.</p>
{% endif %}
<figure>{{ distribution | safe }}</figure>
<figure>{{ bars | safe }}</figure>
<figure>{{ arrows | safe }}</figure>
{% if left_out %}
<p>Targets left out: {{ left_out | length }}</p>
<ul>
{% for each in left_out %}
<li>{{ each }}</li>
{% endfor %}
</ul>
{% endif %}
""",
)
