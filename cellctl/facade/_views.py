"""Parts of the HTML views for notebooks: verdict, table of figures, picture. Nothing is fetched, no script."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from cellctl.kinematics import Floats
from cellctl.records import PASSED
from cellctl.report.drawing import ACCENT, BEFORE, before_and_after, millimetres, svg_of

SHOWN = 10
"""Rows that a view shows; further ones are counted."""

LEAST_MM = 1e-5
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


def view(title: str, *parts: str) -> str:
    """A whole view of its parts."""
    head = f'<p class="title">{escape(title)}</p>'
    return f'<div class="cellctl"><style>{_STYLE}</style>{head}{"".join(parts)}</div>'


def verdict_line(sentence: str | None, verdict: str) -> str:
    """The sentence of a verdict, marked where it is not passed."""
    bad = "" if verdict in PASSED else " bad"
    return f'<p class="verdict{bad}">{escape(sentence or "")}</p>'


def soft(words: str) -> str:
    """A line in grey."""
    return f'<p class="soft">{escape(words)}</p>'


def html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with a row of headings."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{lines}</tbody></table>"


def summary_cells(errors: Floats) -> list[str]:
    """Mean, RMS and maximum of errors (N,), mm."""
    return number_cells([errors.mean(), np.sqrt(np.mean(errors**2)), errors.max()])


def number_cells(values: Iterable[float]) -> list[str]:
    """Numbers with three decimals."""
    return ["< 0.001" if 0.0 < value < 5e-4 else f"{value:.3f}" for value in values]


def _name_of(*drawn: Floats) -> str:
    """A name by the content of a picture: several pictures on one page must not share ids."""
    return f"cellctl-{hashlib.sha256(b''.join(np.ascontiguousarray(each).tobytes() for each in drawn)).hexdigest()[:8]}"


def errors_before_and_after(before: Floats, after: Floats, what: str) -> str:
    """A picture of the distributions of two sets of errors (N,), mm."""
    return before_and_after(_name_of(before, after), before, after, what)


def bars_before_and_after(before: Mapping[str, float], after: Mapping[str, float]) -> str:
    """A picture of mean, RMS and maximum of two sets of errors, mm."""
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


def errors_of_each(
    before: Floats,
    after: Floats,
    what: str = "target",
    labels: tuple[str, str] = ("nominal joints", "compensated joints"),
) -> str:
    """A picture of the predicted error of each target (N,), mm, before and after compensation."""

    def draw(figure: Figure) -> None:
        axes, numbers = figure.subplots(), np.arange(len(before))
        for errors, colour, label in zip((before, after), (BEFORE, ACCENT), labels, strict=True):
            axes.plot(numbers, np.maximum(errors, LEAST_MM), "o", color=colour, markersize=3, label=label)
        axes.set_yscale("log")
        millimetres(axes, "y")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set(xlabel=what, ylabel="predicted error, mm")
        axes.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.18))

    return svg_of(draw, _name_of(before, after), 2.2, "Predicted error of each target, before and after compensation")
