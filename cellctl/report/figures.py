"""The table of errors at the top of a page: mean with its uncertainty, RMS, maximum; before and after."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.formats.measurements.kinds import NOUNS
from cellctl.report.numbers import fixed
from cellctl.report.words import mean_with_uncertainty

Line = dict[str, Any]


def error_line(
    what: str, count: int, before: Mapping[str, Any] | None, after: Mapping[str, Any] | None, predicted: float | None
) -> Line:
    """A line of the table. before, after: `mean`, `rms`, `max` of `count` errors, mm, or None; predicted: RMS, mm."""
    return {
        "what": what,
        "count": count,
        "before": _texts(before, count),
        "after": _texts(after, count),
        "predicted": fixed(predicted) if predicted is not None else "",
    }


def fit_lines(figures: Mapping[str, Any]) -> list[Line]:
    """The lines of a fit, from its JSON: held-out rows, nominal robot (for an updated prior model), rows of the fit."""
    rows = NOUNS.get(figures.get("measure", ""), "rows")
    count, lines = int(figures.get("n_test") or 0), []
    baseline = figures.get("prior") or figures.get("nominal_with_tool")
    if count:
        lines.append(
            error_line(
                f"held-out {rows}",
                count,
                baseline or figures["nominal"],
                figures["test"],
                figures["predicted_test_rms"],
            )
        )
    if count and baseline:
        lines.append(error_line(f"nominal robot, held-out {rows}", count, figures["nominal"], None, None))
    if figures.get("n_fit") and figures.get("fit"):
        lines.append(error_line(f"{rows} of the fit", int(figures["n_fit"]), None, figures["fit"], None))
    return lines


def _texts(errors: Mapping[str, Any] | None, count: int) -> tuple[str, str, str]:
    if errors is None:
        return "", "", ""
    mean = mean_with_uncertainty(errors["mean"], errors["rms"], count)
    return mean, fixed(errors["rms"]), fixed(errors["max"])
