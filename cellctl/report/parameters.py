"""The identified parameters as a person reads them: nominal, deviation with σ, tolerance, and who determined it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import final

from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.model import Parameter
from cellctl.report.numbers import MINUS, significant, with_sigma

_SYMBOLS = {"theta": "θ", "alpha": "α", "beta": "β"}
_FRAME = {"x": "X", "y": "Y", "z": "Z", "a": "A", "b": "B", "c": "C"}
_UNITS = {"mm": "mm", "rad": "°", "1/(N m^2)": "1/(N·m²)"}


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


def symbol(name: str) -> str:
    """`theta2` → `θ2`, `tool_x` → `tool X`, `tool_deflection` → `tool deflection c_t`."""
    if name == "tool_deflection":
        return "tool deflection c_t"
    frame, _, axis = name.partition("_")
    if axis in _FRAME:
        return f"{frame} {_FRAME[axis]}"
    kind, number = _link(name)
    return f"{_SYMBOLS.get(kind, kind)}{number}"


def _row(robot: RobotFile, parameter: Parameter) -> ParameterRow:
    factor = math.degrees(1.0) if parameter.unit == "rad" else 1.0
    sigma = parameter.sigma * factor
    return ParameterRow(
        symbol=symbol(parameter.name),
        unit=_UNITS[parameter.unit],
        nominal=f"{_nominal(robot, parameter.name):.8g}".replace("-", MINUS),
        deviation=with_sigma(parameter.value * factor, sigma),
        tolerance=significant(parameter.prior_sigma * factor),
        prior_share=(parameter.sigma / parameter.prior_sigma) ** 2,
        wide=abs(parameter.value) > 3.0 * parameter.prior_sigma,
    )


def _nominal(robot: RobotFile, name: str) -> float:
    """The robot file's value, mm or degrees; 0 for what it does not hold."""
    frame, _, axis = name.partition("_")
    if axis in _FRAME:
        place = robot.tool if frame == "tool" else robot.base
        return (*place.xyz, *place.abc)["xyzabc".index(axis)]
    if name == "tool_deflection":
        return 0.0
    kind, number = _link(name)
    return float(getattr(robot.links[number - 1], kind) or 0.0)


def _link(name: str) -> tuple[str, int]:
    found = re.fullmatch(r"([a-z]+)(\d+)", name)
    return (found[1], int(found[2])) if found else (name, 0)
