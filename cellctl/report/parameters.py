"""The identified parameters as a person reads them: nominal, deviation with σ, tolerance, and who determined it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import final

from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.model import Parameter
from cellctl.report.numbers import MINUS, significant, with_sigma
from cellctl.report.symbols import shown_unit, symbol

_FRAME = ("x", "y", "z", "a", "b", "c")


@final
@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One free parameter, in mm, degrees or 1/(N·m²), as texts.

    prior_share: σ²/tolerance², 0 to 1: how much of what is known about it was known before a single touch. wide: it is
    more than three tolerances from nominal.
    """

    symbol: str
    unit: str
    nominal: str
    deviation: str
    tolerance: str
    prior_share: float
    wide: bool

    @property
    def seen(self) -> str:
        """Who determined it, in words."""
        if self.prior_share < 0.1:
            return "the data"
        return "both" if self.prior_share < 0.9 else "the tolerance"


def parameter_rows(model: ModelFile) -> list[ParameterRow]:
    """The parameters that were free, in the model's order."""
    return [_row(model.robot, parameter) for parameter in model.parameters if parameter.prior_sigma > 0.0]


def held(model: ModelFile) -> list[str]:
    """The parameters that were held at their nominal values."""
    return [symbol(parameter.name) for parameter in model.parameters if parameter.prior_sigma <= 0.0]


def _row(robot: RobotFile, parameter: Parameter) -> ParameterRow:
    unit, factor = shown_unit(parameter.unit)
    sigma = parameter.sigma * factor
    return ParameterRow(
        symbol=symbol(parameter.name),
        unit=unit,
        nominal=f"{table_value(robot, parameter.name):.8g}".replace("-", MINUS),
        deviation=with_sigma(parameter.value * factor, sigma),
        tolerance=significant(parameter.prior_sigma * factor),
        prior_share=(parameter.sigma / parameter.prior_sigma) ** 2,
        wide=abs(parameter.value) > 3.0 * parameter.prior_sigma,
    )


def table_value(robot: RobotFile, name: str) -> float:
    """What the robot file says of a parameter, mm or degrees; 0 for what it does not hold (an effect, an axis)."""
    frame, _, axis = name.partition("_")
    if frame in ("base", "tool") and axis in _FRAME:
        place = robot.tool if frame == "tool" else robot.base
        return (*place.xyz, *place.abc)[_FRAME.index(axis)]
    found = re.fullmatch(r"(theta|d|a|alpha|beta)(\d+)", name)
    number = int(found[2]) if found else 0
    return float(getattr(robot.links[number - 1], found[1]) or 0.0) if found and number <= len(robot.links) else 0.0
