"""The model from the touches, judged by a tracker: figures of three models, and one picture of their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cellctl.report import (
    ACCENT,
    BEFORE,
    HELD_OUT,
    INK,
    ReportSection,
    Run,
    Sigma,
    error_line,
    fixed,
    millimetres,
    percent,
    svg_of,
)
from procedures.steps.by_tracker.verdict import ByTrackerVerdict, JudgedModel, JudgedPosesRow

_MODELS = (
    ("nominal", "nominal robot", BEFORE),
    ("touches", "model from the touches", ACCENT),
    ("tracker", "model from the tracker's own poses", HELD_OUT),
)
_DIRECTIONS = ("radial", "tangential", "z", "x", "y")


def build(run: Run) -> Mapping[str, Any] | None:
    """Figures by model and direction, and the picture."""
    verdict, poses = run.state.last(ByTrackerVerdict), run.state.last(JudgedPosesRow)
    if verdict is None or verdict.by_tracker is None or poses is None:
        return None
    figures = verdict.by_tracker
    return {
        "n_fit": figures.n_fit,
        "n_test": figures.n_test,
        "models": [_row(title, getattr(figures, name)) for name, title, _ in _MODELS],
        "accuracy": verdict.accuracy,
        "noise_only": verdict.noise_only,
        "held_out": verdict.held_out.verdict if verdict.held_out else "",
        "picture": errors_picture(poses),
    }


def _row(title: str, model: JudgedModel) -> dict[str, Any]:
    along = model.directions
    return {
        "title": title,
        "errors": [fixed(value) for value in (model.errors.mean, model.errors.rms, model.errors.max)],
        "predicted": "" if model.predicted_rms is None else fixed(model.predicted_rms),
        "inside": "" if model.coverage_95 is None else percent(model.coverage_95),
        "directions": [fixed(getattr(along, name)) for name in _DIRECTIONS],
        "scale": f"{along.scale_ppm:+.0f} ± {along.scale_sigma_ppm:.0f}".replace("-", "−"),
    }


def errors_picture(poses: JudgedPosesRow) -> str:
    """Left: share of the held-out poses with less than each error; right: error by distance from A1's axis."""
    place = np.array(poses.place)
    distance = np.linalg.norm(place[:, :2], axis=1)
    shares = np.arange(1, len(place) + 1) / len(place)

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for name, title, colour in _MODELS:
            lengths = np.linalg.norm(np.array(getattr(poses, name)), axis=1)
            left.step(np.sort(lengths), shares, where="post", color=colour, linewidth=1.4, label=title)
            right.plot(distance, lengths, "o", color=colour, markersize=3)
        left.set_ylim(0.0, 1.05)
        left.set_xscale("log")
        millimetres(left)
        left.set(xlabel="position error, mm", ylabel="share of the held-out poses")
        right.set_yscale("log")
        millimetres(right, "y")
        right.set(xlabel="distance from A1's axis, mm", ylabel="position error, mm")
        figure.legend(loc="outside upper center", ncols=3, labelcolor=INK)

    return svg_of(draw, "by-tracker", 2.7, "Position errors of three models at the held-out poses, by the tracker")


def error_lines(run: Run) -> Sequence[Mapping[str, Any]]:
    """Held-out poses: nominal and the model from the touches, then the model from the poses."""
    verdict = run.state.last(ByTrackerVerdict)
    if verdict is None or verdict.by_tracker is None:
        return []
    figures = verdict.by_tracker
    nominal, touches, tracker = (vars(getattr(figures, name).errors) for name, _, _ in _MODELS)
    return [
        error_line("held-out poses, by tracker", figures.n_test, nominal, touches, figures.touches.predicted_rms),
        error_line(
            "model from the tracker's own poses", figures.n_test, nominal, tracker, figures.tracker.predicted_rms
        ),
    ]


SECTION = ReportSection(
    id="by-tracker",
    title="Judged by the tracker",
    order=15,
    needs=(JudgedPosesRow,),
    build=build,
    error_lines=error_lines,
    sigmas=(
        Sigma(
            "predicted, by the tracker",
            "the position error of a model at one held-out pose, and the tracker's",
            "covariance of the model's parameters, of station frame and reflector offset, and the measured point's",
            "RMS over the poses, 3-D",
        ),
        Sigma(
            "scale, 1 σ",
            "the factor by which the errors grow with the distance between the poses",
            "least squares; from the scatter of the errors about it",
            "1 σ",
        ),
    ),
    template="""\
<p>The station's frame and the reflector's offset were fitted to {{ n_fit }} poses, for each model alike. The other
{{ n_test }} poses judge. The model from the touches took nothing else from the tracker; verdict of its own held-out
touches: {{ held_out }}. The instrument has the accuracy profile {{ accuracy }}
{%- if noise_only %}: the noise of such an instrument only, not its behaviour{% endif %}.</p>
<table>
<thead><tr><th>errors, mm</th><th>mean</th><th>RMS</th><th>max</th><th>RMS predicted</th><th>in 95 % region</th>
</tr></thead>
<tbody>
{% for model in models %}
<tr><th>{{ model.title }}</th>{% for value in model.errors %}<td>{{ value }}</td>{% endfor %}
<td>{{ model.predicted }}</td><td>{{ model.inside }}</td></tr>
{% endfor %}
</tbody></table>
<table>
<thead><tr><th>by direction, RMS, mm</th><th>radial</th><th>tangential</th><th>vertical</th><th>X</th><th>Y</th>
<th>scale, ppm (1 σ)</th></tr></thead>
<tbody>
{% for model in models %}
<tr><th>{{ model.title }}</th>{% for value in model.directions %}<td>{{ value }}</td>{% endfor %}
<td>{{ model.scale }}</td></tr>
{% endfor %}
</tbody></table>
<figure>{{ picture | safe }}</figure>
""",
)
