"""The parameters as a table: nominal, deviation with σ, and the σ that was assumed before the rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration import Parameter, Unknowns, functions, kinds
from cellctl.formats import RobotFile
from cellctl.kinematics import Bools, Floats
from cellctl.report.fit.story import FitStory
from cellctl.report.numbers import DASH, MINUS, fixed, significant, with_sigma

LONG = 20
"""A group of more parameters than this is folded until the reader opens it."""

_FRAME = "xyzabc"
_TITLES = {
    "base": "Base",
    "tool": "Tool",
    "zeros": "Joint zeros",
    "links": "Links",
}


@final
@dataclass(frozen=True, slots=True)
class Line:
    """One parameter, as texts. in_assumed_sigmas, in_sigmas: its deviation in its σ before, and after, the rows.

    share: 1 − σ²/assumed σ², the part of the knowledge of it that comes from the rows; the assumed σ is scaled
    if the data show that it is too small. wide: its deviation is above three assumed σ.
    """

    label: str
    unit: str
    nominal: str
    deviation: str
    assumed_sigma: str
    in_assumed_sigmas: str
    in_sigmas: str
    share: float
    wide: bool

    @property
    def decided_by(self) -> str:
        """Its source: the `data`, the assumed `σ`, or `both`."""
        return "data" if self.share > 0.9 else "both" if self.share > 0.1 else "σ"


@final
@dataclass(frozen=True, slots=True)
class Group:
    """Parameters of one kind."""

    title: str
    lines: tuple[Line, ...]

    @property
    def folded(self) -> bool:
        """Whether there are too many to show unfolded."""
        return len(self.lines) > LONG


def known_before(story: FitStory) -> Floats:
    """Assumed 1 σ of each parameter (P,) before the rows, scaled if the data show that it is too small."""
    return _sigma(story.found.unknowns)


def _sigma(unknowns: Unknowns) -> Floats:
    return unknowns.sigma if unknowns.prior is None else np.sqrt(np.diag(unknowns.prior))


def found_anew(story: FitStory) -> Bools:
    """Which parameters (P,) have no prior: points, and base and tool in an instrument's frame."""
    unknowns, tolerances = story.found.unknowns, story.task.tolerances
    place = unknowns.among(frozenset({"base", "tool", "points", "datums"}))
    return np.asarray(place & (known_before(story) >= min(tolerances.flat_rad, tolerances.flat_mm)))


def groups(story: FitStory) -> list[Group]:
    """The free parameters of the robot in its first session, by kind, without those without assumed σ (`places`)
    and without the coefficients of random functions (`coefficients`).
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
    """Number of coefficients of each random function."""
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
    assumed = float(_sigma(story.result.identification.nominal.unknowns)[index]) * factor
    return Line(
        label=parameter.label,
        unit=parameter.unit.shown,
        nominal=f"{table_value(story.robot, parameter) + before * factor:.8g}".replace("-", MINUS),
        deviation=with_sigma(change, sigma),
        assumed_sigma=significant(assumed),
        in_assumed_sigmas=_times(change, assumed),
        in_sigmas=_times(change, sigma),
        share=1.0 - (sigma / before_it) ** 2 if before_it else 0.0,
        wide=abs(change) > 3.0 * assumed,
    )


def _before(story: FitStory, parameter: Parameter) -> float:
    """The deviation of this parameter in the prior model, in its own unit."""
    return story.task.model.amount(parameter.name) or 0.0


def _times(change: float, sigma: float) -> str:
    return fixed(change / sigma, 1) if sigma > 0.0 else DASH


def table_value(robot: RobotFile, parameter: Parameter) -> float:
    """The value of a parameter in the robot file, mm or degrees; 0 if the file has none (an effect, an axis)."""
    if parameter.group in ("base", "tool"):
        place = robot.tool if parameter.group == "tool" else robot.base
        return (*place.xyz, *place.abc)[_FRAME.index(parameter.axis)]
    if not parameter.column or parameter.joint > len(robot.links):
        return 0.0
    return float(getattr(robot.links[parameter.joint - 1], parameter.column) or 0.0)
