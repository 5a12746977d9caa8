"""The parameters as a table: nominal, deviation, σ and tolerance, and what each is in the other's terms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration import Parameter, Unknowns, functions, kinds
from cellctl.kinematics import Bools, Floats
from cellctl.report.fit.story import FitStory
from cellctl.report.numbers import DASH, MINUS, fixed, significant, with_sigma
from cellctl.report.parameters import table_value

LONG = 20
"""A group of more parameters than this is folded away until somebody asks for it."""

_TITLES = {
    "base": "Base",
    "tool": "Tool",
    "zeros": "Joint zeros",
    "links": "Links",
}


@final
@dataclass(frozen=True, slots=True)
class Line:
    """One parameter, as texts. in_tolerances, in_sigmas: its deviation in what was, and in what is, its 1 σ.

    share: 1 − σ²/tolerance², how much of what is known about it the rows told; tolerance there as widened, where the
    rows said that the stated one is too narrow. wide: more than three tolerances off.
    """

    symbol: str
    unit: str
    nominal: str
    deviation: str
    tolerance: str
    in_tolerances: str
    in_sigmas: str
    share: float
    wide: bool

    @property
    def teller(self) -> str:
        """Who determined it."""
        return "data" if self.share > 0.9 else "both" if self.share > 0.1 else "tolerance"


@final
@dataclass(frozen=True, slots=True)
class Group:
    """Parameters of one kind."""

    title: str
    lines: tuple[Line, ...]

    @property
    def folded(self) -> bool:
        """Whether there are too many to show unasked."""
        return len(self.lines) > LONG


def known_before(story: FitStory) -> Floats:
    """1 σ of each parameter (P,) before the rows, widened where these said so."""
    return _sigma(story.found.unknowns)


def _sigma(unknowns: Unknowns) -> Floats:
    return unknowns.sigma if unknowns.prior is None else np.sqrt(np.diag(unknowns.prior))


def found_anew(story: FitStory) -> Bools:
    """Which parameters (P,) nobody knew anything of before: points, and base and tool in an instrument's frame."""
    unknowns, tolerances = story.found.unknowns, story.task.tolerances
    place = unknowns.among(frozenset({"base", "tool", "points", "datums"}))
    return np.asarray(place & (known_before(story) >= min(tolerances.flat_rad, tolerances.flat_mm)))


def groups(story: FitStory) -> list[Group]:
    """The free parameters of the robot in its first session, by kind; what had no tolerance is left to the places.
    Coefficients of random functions are none (`coefficients`).
    """
    unknowns = story.found.unknowns
    shown = (
        unknowns.free
        & ~unknowns.among(functions())
        & ~found_anew(story)
        & (np.arange(len(unknowns.names)) < unknowns.robot)
    )
    lines: dict[str, list[int]] = {}
    for index in np.flatnonzero(shown).tolist():
        lines.setdefault(unknowns.groups[index], []).append(index)
    titles = _TITLES | {group: kind.title for group, kind in kinds().items()}
    ordered = [group for group in titles if group in lines]
    return [Group(titles[group], tuple(_line(story, index) for index in lines[group])) for group in ordered]


def coefficients(story: FitStory) -> dict[str, int]:
    """How many coefficients each random function has."""
    groups = story.found.unknowns.groups
    return {group: groups.count(group) for group in sorted(functions() & set(groups))}


def held(story: FitStory) -> list[str]:
    """The robot's parameters that were held."""
    unknowns = story.found.unknowns
    return [unknowns.parameters[index].label for index in np.flatnonzero(~unknowns.free) if index < unknowns.robot]


def _line(story: FitStory, index: int) -> Line:
    found, model = story.found, story.found.state.model
    parameter = found.unknowns.parameters[index]
    factor = parameter.unit.factor
    before = _before(story, parameter)
    change = (float(model.deviations[index]) - before) * factor
    sigma = float(np.sqrt(max(found.covariance[index, index], 0.0))) * factor
    before_it = float(known_before(story)[index]) * factor
    tolerance = float(_sigma(story.result.identification.nominal.unknowns)[index]) * factor
    return Line(
        symbol=parameter.label,
        unit=parameter.unit.shown,
        nominal=f"{table_value(story.robot, parameter) + before * factor:.8g}".replace("-", MINUS),
        deviation=with_sigma(change, sigma),
        tolerance=significant(tolerance),
        in_tolerances=_times(change, tolerance),
        in_sigmas=_times(change, sigma),
        share=1.0 - (sigma / before_it) ** 2 if before_it else 0.0,
        wide=abs(change) > 3.0 * tolerance,
    )


def _before(story: FitStory, parameter: Parameter) -> float:
    """What the model that was gone on from already had of this parameter, in its own unit."""
    return story.task.model.amount(parameter.name) or 0.0


def _times(change: float, sigma: float) -> str:
    return fixed(change / sigma, 1) if sigma > 0.0 else DASH
