"""The held-out targets before and after the table, with the pictures of a tracker campaign."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.kinematics import Bools, Floats
from cellctl.report import (
    ACCENT,
    BEFORE,
    HELD_OUT,
    INK,
    ReportSection,
    Run,
    Sigma,
    before_and_after,
    error_line,
    fixed,
    millimetres,
    percent,
    significant,
    svg_of,
)
from procedures.steps.tracker.rows import (
    ON_LINE,
    MonumentsRow,
    NestRow,
    ReturnRow,
    TargetErrorsRow,
    TargetFigures,
    TargetsRow,
    TrackerVerdict,
)


def bars_picture(numbers: Sequence[int], before: Floats, after: Floats, sigma: Floats, late: Bools) -> str:
    """3-D errors (N,), mm, of each target before and after, with the predicted 1 σ after; late: of the late block."""

    def draw(figure: Figure) -> None:
        axes, at = figure.subplots(), np.arange(len(numbers))
        axes.bar(at, before, 0.8, color=BEFORE, alpha=0.45, label="before, nominal joints")
        axes.bar(at, after, 0.5, color=ACCENT, label="after, table in force")
        if sigma.size:
            axes.plot(at, sigma, "_", color=INK, markersize=5, label="predicted 1 σ after")
        if late.any():
            first = int(np.flatnonzero(late)[0]) - 0.5
            axes.axvline(first, color=HELD_OUT, linewidth=1.0)
            axes.text(first + 0.2, 0.97, "late block", color=HELD_OUT, transform=axes.get_xaxis_transform(), va="top")
        axes.set_yscale("log")
        millimetres(axes, "y")
        every = max(1, len(numbers) // 15)
        axes.set_xticks(at[::every], [str(number) for number in numbers[::every]])
        axes.set(xlabel="held-out pose, by its number in the plan", ylabel="position error, mm", xlim=(-0.7, len(at)))
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        axes.grid(axis="x", visible=False)

    return svg_of(draw, "target-bars", 2.4, "Position error of each held-out target, before and after")


def arrows_picture(places: Floats, before: Floats, after: Floats) -> str:
    """Errors (N, 3), mm, as arrows at places (N, 3), mm, of the robot's base frame, seen from above and from a side."""

    def draw(figure: Figure) -> None:
        pair = figure.subplots(1, 2)
        for axes, (a, b), names in zip(pair, ((0, 1), (0, 2)), ("XY", "XZ"), strict=True):
            longest = float(np.linalg.norm(before, axis=1).max())
            scale = longest / (0.15 * max(float(np.ptp(places[:, a])), 1.0))
            for errors, colour, label in ((before, BEFORE, "before"), (after, ACCENT, "after")):
                axes.quiver(
                    places[:, a], places[:, b], errors[:, a], errors[:, b],
                    angles="xy", scale_units="xy", scale=scale, color=colour, width=0.004, label=label,
                )  # fmt: skip
            axes.set_aspect("equal", adjustable="datalim")
            axes.set(xlabel=f"{names[0]} of the base, mm", ylabel=f"{names[1]} of the base, mm")
        pair[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        pair[1].set_title(f"longest arrow {longest:.2f} mm", loc="left")

    return svg_of(draw, "target-arrows", 3.0, "Errors of the held-out targets as arrows, before and after")


def nests_picture(nests: Sequence[NestRow], visits: Sequence[MonumentsRow], returns: Sequence[ReturnRow]) -> str:
    """Displacement of each nest, and of the return pose, since the first visit, over the run."""
    began = min([row.point.time_ns for row in nests] + [row.point.time_ns for row in returns])

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for name, marker in zip(dict.fromkeys(row.nest for row in nests), "osD^vP*X", strict=False):
            mine = [row for row in nests if row.nest == name]
            axes.plot(*_shifts(mine, began), f"{marker}-", markersize=4, linewidth=0.8, label=name)
        if returns:
            axes.plot(*_shifts(returns, began), "x--", color=INK, markersize=5, linewidth=0.8, label="return pose")
        for visit in visits:
            if visit.verdict != "still":
                at = max(row.point.time_ns for row in nests if row.visit == visit.visit)
                axes.axvline((at - began) / 60e9, color=HELD_OUT, linewidth=1.0)
        axes.set(xlabel="time, min", ylabel="displacement, mm")
        axes.set_ylim(bottom=0.0)
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))

    return svg_of(draw, "nests", 2.1, "Displacement of the nests and of the return pose over the run")


def _shifts(rows: Sequence[NestRow] | Sequence[ReturnRow], began: int) -> tuple[Floats, Floats]:
    """Minutes since the run began, and distance from the first place, mm."""
    places = np.array([row.point.xyz for row in rows])
    minutes = (np.array([row.point.time_ns for row in rows]) - began) / 60e9
    return minutes, np.linalg.norm(places - places[0], axis=1)


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
    expected = ", the model states no σ"
    if found.predicted_sigma is not None:
        ratio = significant(found.found_sigma / found.predicted_sigma) if found.predicted_sigma else "–"
        expected = f" where {significant(found.predicted_sigma)} mm was predicted (ratio {ratio})"
    yield (
        f"After: found {significant(found.found_sigma)} mm RMS{expected}; "
        f"{significant(found.interleaved_after)} mm of targets interleaved with the fit, "
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


def errors(run: Run) -> Sequence[float]:
    """Of the targets with the table in force, 3-D."""
    row = run.state.last(TargetErrorsRow)
    return np.linalg.norm(row.after, axis=1).tolist() if row else ()


SECTION = ReportSection(
    id="tracker-targets",
    title="Proof by held-out targets",
    order=20,
    needs=(TargetErrorsRow,),
    build=build,
    error_lines=error_lines,
    errors=errors,
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
