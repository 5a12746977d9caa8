"""Figures on a page: numbers in metrological notation, their meaning in sentences, the table of errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from cellctl.calibration.verdict.agreement import Agreement
from cellctl.formats.measurements.kinds import noun_of

MINUS, DASH = "\N{MINUS SIGN}", "\N{EN DASH}"


def decimals(sigma: float, digits: int = 2) -> int:
    """Number of decimals that shows `sigma` with `digits` significant digits; at most 9."""
    if not math.isfinite(sigma) or sigma <= 0.0:
        return 3
    rounded = float(f"{sigma:.{digits - 1}e}")  # 0.0996 rounds to 0.10, with one decimal less
    return min(9, max(0, digits - 1 - math.floor(math.log10(rounded))))


def fixed(value: float | None, places: int = 3) -> str:
    """`value` with `places` decimals and a true minus sign; a dash for None, NaN and infinities."""
    if value is None or not math.isfinite(value):
        return DASH
    text = f"{value:.{places}f}"
    return text.lstrip("-") if float(text) == 0.0 else text.replace("-", MINUS)


def significant(value: float | None, digits: int = 2) -> str:
    """`value` with `digits` significant digits, never as a power of ten."""
    if value is None or not math.isfinite(value):
        return DASH
    return fixed(value, decimals(abs(value), digits)) if value else "0"


def with_sigma(value: float, sigma: float) -> str:
    """`−1.571 ± 0.037`; the value alone, to three decimals, unless σ is above 0."""
    if not math.isfinite(sigma) or sigma <= 0.0:
        return fixed(value)
    places = decimals(sigma)
    return f"{fixed(value, places)} ± {fixed(sigma, places)}"


def percent(share: float | None) -> str:
    """A share in whole per cent; `< 1 %` and `> 99 %` unless it is exactly 0 or 100."""
    if share is None or not math.isfinite(share):
        return DASH
    if 0.0 < share < 0.005:
        return "< 1 %"
    return "> 99 %" if 0.995 <= share < 1.0 else f"{100.0 * share:.0f} %"


def plain(value: Any) -> str:
    """Any journal value as text: floats to four significant digits at most, flags as yes and no, lists inline."""
    match value:
        case None:
            return DASH
        case bool():
            return "yes" if value else "no"
        case float():
            return _short(value)
        case dict():
            return ", ".join(f"{_spaced(key)} {plain(item)}" for key, item in value.items())
        case list() | tuple():
            return ", ".join(plain(item) for item in value)
        case _:
            return str(value)


def _short(value: float) -> str:
    text = significant(value, 4)
    return text.rstrip("0").rstrip(".") if "." in text else text


def _spaced(key: object) -> str:
    return str(key).replace("_", " ")


HARMLESS = (
    "These parameters can change together without moving anything that was measured: the place of the whole robot, the "
    "mounting of the tool on the last link, a rotation about a measured point. Another tool may depend on it, and so "
    "may the orientation where none was measured."
)
OTHERWISE = "What the data do not determine stays at its nominal value, within its assumed σ. Every σ contains that."


@final
@dataclass(frozen=True, slots=True)
class Reason:
    """The unobservable combinations of parameters, the reasons and the consequence; may be empty."""

    cause: str
    meaning: str
    phrases: Sequence[str]


def reasons(figures: Mapping[str, Any]) -> list[Reason]:
    """From a fit's figures in its JSON; older fits have the combinations without a reason."""
    known = [{"cause": _UNTOLD, "harmless": False, "words": list(figures.get("unobservable") or [])}]
    found = figures.get("unseen", [each for each in known if each["words"]])
    return [Reason(_sentence(each["cause"]), _meaning(each), each["words"]) for each in found]


_UNTOLD = "these rows do not tell apart"


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."


def _meaning(cause: Mapping[str, Any]) -> str:
    if not cause["words"]:
        return ""
    return HARMLESS if cause["harmless"] else OTHERWISE


def mean_with_uncertainty(mean: float, rms: float, count: int) -> str:
    """`0.0133 ± 0.0027`: the mean of `count` errors, mm, and its standard uncertainty s/√n."""
    if count < 2:
        return fixed(mean)
    spread = max(rms * rms - mean * mean, 0.0) * count / (count - 1)
    return with_sigma(mean, (spread / count) ** 0.5)


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
    rows = noun_of(figures.get("measure", ""))
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


def acceptance_words(found: Mapping[str, Any]) -> str:
    """The decision on an acceptance limit by its JSON: `accepted: maximum 0.078 mm, U = 0.034 mm (k = 1.96), …`."""
    measurand = str(found["measurand"]).replace("_95", " 95 %")
    expanded = f", U = {significant(found['U_mm'])} mm (k = {fixed(found['k'], 2)}, 95 %)" if found["U_mm"] else ""
    value = f"{measurand} {fixed(found['value_mm'])} mm{expanded}, limit {found['limit_mm']:g} mm"
    return f"{found['decision']}: {value}. {found['reason']}"


def agreement_lines(agreed: Agreement) -> list[str]:
    """The figures of two calibrations a and b of one robot, in sentences."""
    lines = []
    if (figures := agreed.figures) is not None:
        lines.append(
            f"In the {agreed.degrees_of_freedom} directions that both determined: {fixed(figures.difference_rms_mm)} "
            f"mm apart (RMS), σ {fixed(figures.sigma_rms_mm)} mm; b is larger than a by "
            f"{with_sigma(figures.scale_ppm, figures.scale_sigma_ppm)} ppm (1 σ)."
        )
    if agreed.not_determined:
        lines.append(f"Not determined by both: {', '.join(agreed.not_determined)}.")
    return lines
