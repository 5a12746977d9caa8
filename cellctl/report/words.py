"""The meaning of the figures, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from cellctl.report.numbers import fixed, with_sigma

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
