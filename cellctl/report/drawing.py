"""Style of the pictures, and conversion of a figure to inline SVG: text stays text; same figure, same bytes."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter
from matplotlib.typing import RcKeyType

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
    return _inline(stream.getvalue(), name, alt)


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
