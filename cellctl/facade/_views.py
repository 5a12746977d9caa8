"""HTML views for notebooks: a verdict, a table of figures, a picture. Nothing is fetched, no script."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cellctl.kinematics import Floats
from cellctl.operations.fitting import Fitted
from cellctl.records import PASSED
from cellctl.report import Run as Content
from cellctl.report.drawing import ACCENT, BEFORE, before_and_after, millimetres, svg_of
from cellctl.report.figures import fit_lines

if TYPE_CHECKING:
    from cellctl.facade._fits import Data, Robot
    from cellctl.facade._models import Model, Prediction
    from cellctl.facade._runs import Run
    from cellctl.facade._targets import CompensatedProgram, Compensation

SHOWN = 10
"""Rows that a view shows; further ones are counted."""

_LEAST_MM = 1e-5
"""Smaller errors are drawn at this value: a logarithmic axis has no zero."""

_STYLE = """\
.cellctl{max-width:46rem;padding:.6rem .9rem;background:#fff;color:#222;border:1px solid #ddd;
font:13px/1.4 "Helvetica Neue",Arial,"Liberation Sans",sans-serif}
.cellctl p{margin:.3rem 0}.cellctl .title{font-weight:600}.cellctl .soft{color:#666}
.cellctl .verdict{padding:.4rem .7rem;border-left:4px solid #0b5394;background:#f4f7fb}
.cellctl .verdict.bad{border-color:#a33b00;background:#fdf5f0}
.cellctl table{margin:.5rem 0;border-collapse:collapse;background:none;font-variant-numeric:tabular-nums}
.cellctl th,.cellctl td{padding:.12rem .6rem;text-align:right;color:#222;background:none;border:0}
.cellctl th:first-child,.cellctl td:first-child{padding-left:0;text-align:left}
.cellctl thead th{border-bottom:1px solid #666}.cellctl svg{display:block;width:100%;height:auto}
"""

_UNITS = {"A": "deg", "q": "rad", "D": "direction", "I": "A"}
_MM, _DEG = {"X", "Y", "Z", "sX", "sY", "sZ", "radius", "distance"}, {"A", "B", "C"}


def robot_view(robot: Robot) -> str:
    """A nominal robot: joints and their limits."""
    file = robot.file
    rows = [
        [f"A{number}", f"{joint.min:g}", f"{joint.max:g}", f"{joint.max_speed:g}"]
        for number, joint in enumerate(file.joints, 1)
    ]
    xyz = ", ".join(f"{value:g}" for value in file.tool.xyz)
    facts = f"{file.convention}, repeatability {file.repeatability:g} mm (1 σ, 3-D), tool at {xyz} mm"
    return _view(robot.name, _soft(facts), _table(["joint", "least, deg", "greatest, deg", "deg/s"], rows))


def data_view(data: Data) -> str:
    """A data set: the range of each column."""
    rows = [_range(name, data[name]) for name in data.columns]
    rejected = [_soft(f"line {row.line}: {row.reason}") for row in data.rows.rejected[:SHOWN]]
    head = ["column", "unit", "values", "least", "greatest"]
    return _view(f"{data.rows.file}: {len(data)} rows", _table(head, rows), *rejected)


def model_view(model: Model, fit: Fitted | None) -> str:
    """An identified robot: verdict, errors of nominal and identified on held-out rows, with a picture of both."""
    report = model.report
    parts = [_verdict(model.sentence, model.verdict), _errors(fit_lines(report))]
    if fit is not None and fit.result.n_test:
        result = fit.result
        before = result.nominal_errors if result.nominal_with_tool_errors is None else result.nominal_with_tool_errors
        parts.append(_before_and_after(before, result.test_errors, "held-out error"))
    elif report.get("n_test"):
        parts.append(_bars(report.get("nominal_with_tool") or report["nominal"], report["test"]))
    facts = [f"{report[key]} {words}" for key, words in _COUNTS.items() if report.get(key) is not None]
    return _view(f"{model.file.robot.name}: {model.file.model}", *parts, _soft(", ".join(facts)))


_COUNTS = {"n_fit": "rows to fit", "n_test": "held out", "n_parameters": "parameters", "rank": "observable"}


def prediction_view(found: Prediction) -> str:
    """Predicted TCPs: the first rows, with σ."""
    values = np.column_stack([found.positions, found.sigma_mm])[:SHOWN]
    marks = ["" if inside else "outside the measured region" for inside in found.inside]
    rows = [[str(row), *_fixed(line), mark] for row, (line, mark) in enumerate(zip(values, marks, strict=False))]
    left = len(found) - len(rows)
    outside = int((~found.inside).sum())
    title = f"{len(found)} postures predicted, {outside} outside the measured region"
    more = [_soft(f"… and {left} more")] if left else []
    return _view(title, _table(["row", "X, mm", "Y, mm", "Z, mm", "1 σ, mm", ""], rows), *more)


def compensation_view(found: Compensation) -> str:
    """Compensated targets: predicted errors before and after, and the targets that have no joints."""
    reached, count = found.reached, len(found)
    title = f"{int(reached.sum())} of {count} targets compensated by {found.method}"
    missing = [(row, reason) for row, reason in enumerate(found.reasons) if reason]
    reasons = [_soft(f"target {row}: {reason}") for row, reason in missing[:SHOWN]]
    if len(missing) > SHOWN:
        reasons.append(_soft(f"… and {len(missing) - SHOWN} more"))
    if not reached.any():
        return _view(title, *reasons)
    pairs = {"nominal joints": found.predicted_before_mm, "compensated joints": found.predicted_after_mm}
    rows = [[name, *_figures(errors[reached])] for name, errors in pairs.items()]
    if np.isfinite(found.sigma_mm[reached]).all():
        rows.append(["1 σ of the prediction", *_figures(found.sigma_mm[reached])])
    turned = float(np.abs(found.joints - found.nominal_joints)[reached].max())
    head = ["predicted error, mm", "mean", "RMS", "max"]
    words = _soft(f"Joints corrected by up to {turned:.3f}°. Errors below {_LEAST_MM:g} mm are drawn at that value.")
    return _view(
        title, _table(head, rows), _each_target(found.predicted_before_mm, found.predicted_after_mm), words, *reasons
    )


def program_view(program: CompensatedProgram) -> str:
    """A compensated program: corrections and predicted errors of its points, and the places that stay as they were."""
    report = program.report
    keys = {
        "before_mm": "predicted error before, mm",
        "after_mm": "after, mm",
        "correction_mm": "shift of the points, mm",
        "correction_deg": "correction of the joints, deg",
    }
    rows = [[words, *_fixed([report[key][name] for name in ("mean", "rms", "max")])] for key, words in keys.items()]
    left = [_soft(f"{each['file']}:{each['line']}: {each['name']} {each['reason']}") for each in report["left"][:SHOWN]]
    if len(report["left"]) > SHOWN:
        left.append(_soft(f"… and {len(report['left']) - SHOWN} more"))
    before, after = (np.array([point[key] for point in report["points"]]) for key in ("before_mm", "after_mm"))
    picture = _each_target(before, after, "point", ("before", "after"))
    return _view(program.counts, _table(["", "mean", "RMS", "max"], rows), picture, *left)


def run_view(run: Run, content: Content) -> str:
    """A run: state, verdict, measured errors before and after."""
    parts = [_verdict(run.sentence, run.verdict or "")] if run.sentence else []
    if run.before and run.after and None not in (run.before["mean"], run.after["mean"]):
        pairs = (("before", run.before), ("after", run.after))
        rows = [[name, *_fixed([errors[key] for key in ("mean", "rms", "max")])] for name, errors in pairs]
        parts += [_table(["measured error, mm", "mean", "RMS", "max"], rows), _bars(run.before, run.after)]
    facts = [f"{run.report['points']} points", str(run.report["table_state"] or "no table"), str(run.report["began"])]
    complaints = [_soft(words) for words in content.complaints]
    return _view(f"{run.name}: {content.title}, {run.state}", *parts, _soft(", ".join(facts)), *complaints)


def _view(title: str, *parts: str) -> str:
    head = f'<p class="title">{escape(title)}</p>'
    return f'<div class="cellctl"><style>{_STYLE}</style>{head}{"".join(parts)}</div>'


def _verdict(sentence: str | None, verdict: str) -> str:
    bad = "" if verdict in PASSED else " bad"
    return f'<p class="verdict{bad}">{escape(sentence or "")}</p>'


def _soft(words: str) -> str:
    return f'<p class="soft">{escape(words)}</p>'


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table>"


def _errors(lines: Iterable[Mapping[str, Any]]) -> str:
    """Errors of nominal and identified robot, as on the page of the fit."""
    rows = []
    for line in lines:
        for key, name in (("before", "nominal"), ("after", "identified")):
            if any(line[key]):
                rows.append([f"{line['what']}, {name}", *line[key]])
    return _table(["error, mm", "mean", "RMS", "max"], rows)


def _range(name: str, values: Any) -> list[str]:
    if values.dtype.kind != "f":
        labels = sorted({text for text in values.tolist() if text})
        some = ", ".join(labels[:3]) + (", …" if len(labels) > 3 else "")
        return [name, "", str(sum(map(bool, values.tolist()))), some, ""]
    filled = values[np.isfinite(values)]
    ends = [f"{filled.min():.6g}", f"{filled.max():.6g}"] if filled.size else ["", ""]
    return [name, _unit(name), str(filled.size), *ends]


def _unit(name: str) -> str:
    if name in _MM or name in _DEG:
        return "mm" if name in _MM else "deg"
    return _UNITS.get(name[:1], "") if name[1:].isdigit() else {"temperature": "°C", "payload": "kg"}.get(name, "")


def _figures(errors: Floats) -> list[str]:
    return _fixed([errors.mean(), np.sqrt(np.mean(errors**2)), errors.max()])


def _fixed(values: Iterable[float]) -> list[str]:
    return ["< 0.001" if 0.0 < value < 5e-4 else f"{value:.3f}" for value in values]


def _name_of(*drawn: Floats) -> str:
    """A name by the content of a picture: several pictures on one page must not share ids."""
    return f"cellctl-{hashlib.sha256(b''.join(np.ascontiguousarray(each).tobytes() for each in drawn)).hexdigest()[:8]}"


def _before_and_after(before: Floats, after: Floats, what: str) -> str:
    return before_and_after(_name_of(before, after), before, after, what)


def _bars(before: Mapping[str, float], after: Mapping[str, float]) -> str:
    keys = ("mean", "rms", "max")
    heights = [np.array([each[key] for key in keys]) for each in (before, after)]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for place, values, colour, label in zip(
            (-0.2, 0.2), heights, (BEFORE, ACCENT), ("before", "after"), strict=True
        ):
            axes.barh(np.arange(3) + place, values, 0.38, color=colour, label=label)
        axes.set_yticks(range(3), ["mean", "RMS", "max"])
        axes.invert_yaxis()
        axes.set(xlabel="error, mm")
        axes.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.22))

    return svg_of(draw, _name_of(*heights), 1.8, "Errors before and after: mean, RMS, maximum")


def _each_target(
    before: Floats,
    after: Floats,
    what: str = "target",
    labels: tuple[str, str] = ("nominal joints", "compensated joints"),
) -> str:
    def draw(figure: Figure) -> None:
        axes, numbers = figure.subplots(), np.arange(len(before))
        for errors, colour, label in zip((before, after), (BEFORE, ACCENT), labels, strict=True):
            axes.plot(numbers, np.maximum(errors, _LEAST_MM), "o", color=colour, markersize=3, label=label)
        axes.set_yscale("log")
        millimetres(axes, "y")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel=what, ylabel="predicted error, mm")
        axes.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.18))

    return svg_of(draw, _name_of(before, after), 2.2, "Predicted error of each target, before and after compensation")
