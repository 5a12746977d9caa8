"""Pictures as inline SVG or files: their style, the same bytes for the same figure; histogram and curve of errors."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any, TypeAlias, final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from matplotlib.typing import RcKeyType

from cellctl.kinematics import Floats

ACCENT, BEFORE, INK, FAINT, HELD_OUT = "#0b5394", "#8c8c8c", "#222222", "#d9d9d9", "#d1780b"
DIVERGING = matplotlib.colormaps["RdBu_r"].resampled(31)
"""Colour map with few enough colours that its scale is drawn, not embedded as an image."""
WIDTH = 7.2
"""Inches: the text width of an A4 page."""

_STYLE: dict[RcKeyType, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "cellctl report",
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "text.parse_math": False,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "axes.edgecolor": "#666666",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#ececec",
    "grid.linewidth": 0.6,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}


_PNG_DPI = 200


@final
@dataclass(frozen=True, slots=True)
class Picture:
    """A picture of a page as files. name: unique on the page; alt: what it shows."""

    name: str
    alt: str
    svg: bytes
    png: bytes


_COLLECTED: ContextVar[list[Picture] | None] = ContextVar("collected pictures", default=None)


@contextmanager
def collected_pictures() -> Iterator[list[Picture]]:
    """A list to which `svg_of` adds every picture that is drawn meanwhile, in their order."""
    found: list[Picture] = []
    before = _COLLECTED.set(found)
    try:
        yield found
    finally:
        _COLLECTED.reset(before)


def svg_of(draw: Callable[[Figure], None], name: str, height: float, alt: str) -> str:
    """What `draw` draws on a figure as wide as the page and `height` inches high, as an inline `<svg>`.

    name: unique on the page; alt: text alternative of the picture.
    """
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        stream = io.StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
        if (found := _COLLECTED.get()) is not None:
            found.append(Picture(name, alt, stream.getvalue().encode(), _png(figure)))
    return _inline(stream.getvalue(), name, alt)


def _png(figure: Figure) -> bytes:
    """White behind it: other programs show a transparent picture on any ground."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_PNG_DPI, facecolor="white", metadata={"Software": None})
    return stream.getvalue()


def millimetres(axes: Axes, which: str = "x") -> None:
    """Plain numbers instead of powers of ten on a logarithmic axis."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _inline(text: str, name: str, alt: str) -> str:
    """The `<svg>` element alone, with ids unique on the page, without metadata and fixed size."""
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", text)
    text = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    return text.replace("<svg", f'<svg role="img" aria-label="{alt}"', 1).strip()


Sets: TypeAlias = list[tuple[str, Floats, str, str]]
"""Label, errors (N,), mm, colour, hatch."""

_LEAST_MM = 1e-3
"""Smaller errors are drawn at this value, mm: a logarithmic axis has no zero, and touches do not resolve 1 µm."""


def before_and_after(name: str, before: Floats, after: Floats, what: str) -> str:
    """Histogram and cumulative curve of |errors| (N,), mm, on one logarithmic axis."""
    sets = [("before", before, BEFORE, ""), ("after", after, ACCENT, "////")]
    shown: Sets = [(label, np.maximum(np.abs(e), _LEAST_MM), *look) for label, e, *look in sets if e.size]

    def draw(figure: Figure) -> None:
        counts, cumulative = figure.subplots(1, 2, sharex=True)
        _histogram(counts, shown, what)
        _cumulative(cumulative, shown, what)

    return svg_of(draw, name, 2.3, f"Histogram and cumulative curve of {what}, before and after")


def one_by_one(name: str, numbers: Floats, errors: Floats, sigma: Floats, what: str) -> str:
    """Signed errors (N,), mm, over their number, each with its predicted 1 σ (N,)."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axhline(0.0, color=INK, linewidth=0.6)
        axes.errorbar(numbers, errors, sigma, fmt="o", color=ACCENT, markersize=3, elinewidth=0.8)
        axes.set(xlabel="target", ylabel=f"{what}, mm")
        axes.set_title("after, one by one, with predicted 1 σ", loc="left")

    return svg_of(draw, name, 1.9, f"{what} of each target with its predicted standard deviation")


def _histogram(axes: Axes, sets: Sets, what: str) -> None:
    everything = np.concatenate([errors for _, errors, *_ in sets])
    lower, upper = np.floor(np.log10(everything.min()) * 4) / 4, np.ceil(np.log10(everything.max()) * 4) / 4
    edges = (10.0 ** np.arange(lower, max(upper, lower + 0.25) + 0.01, 0.125)).tolist()
    for label, errors, colour, hatch in sets:
        axes.hist(errors, edges, color=colour, alpha=0.75, label=label, hatch=hatch, edgecolor="white", linewidth=0.4)
    axes.set_xscale("log")
    millimetres(axes)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel=f"{what}, mm", ylabel="count")
    axes.legend(loc="upper center", ncols=2, bbox_to_anchor=(0.5, 1.16))


def _cumulative(axes: Axes, sets: Sets, what: str) -> None:
    highest = max(float(np.median(errors)) for _, errors, *_ in sets)
    for label, errors, colour, _ in sets:
        steps = np.arange(len(errors) + 1) / len(errors) * 100.0
        at, median = np.concatenate([[errors.min()], np.sort(errors)]), float(np.median(errors))
        axes.step(at, steps, where="post", color=colour, linewidth=1.6, label=label)
        axes.plot(median, 50.0, "o", color=colour, markersize=4)
        aside: dict[str, Any] = {"xytext": (-6, 0), "ha": "right"}
        if len(sets) > 1 and median == highest:
            aside = {"xytext": (6, 0), "ha": "left"}
        place = {**aside, "textcoords": "offset points", "va": "center"}
        axes.annotate(f"median {median:.3f}", (median, 50.0), fontsize=7, color=INK, **place)
    axes.set_xscale("log")
    millimetres(axes)
    axes.set(xlabel=f"{what}, mm", ylabel="share not above, %", ylim=(0, 102))
    axes.axhline(95.0, color="#bbbbbb", linewidth=0.6, linestyle="--")
    axes.text(0.01, 94.0, "95 %", fontsize=6.5, va="top", transform=axes.get_yaxis_transform(), color="#666666")
