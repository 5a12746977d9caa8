"""The identified parameters as a person reads them: nominal, deviation with σ, tolerance, and who determined it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from cellctl.calibration import Parameter
from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.model import Parameter as StoredParameter
from cellctl.report.numbers import MINUS, significant, with_sigma

_FRAME = "xyzabc"


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
    return [_row(model.robot, *pair) for pair in _pairs(model) if pair[1].prior_sigma > 0.0]


def held(model: ModelFile) -> list[str]:
    """The parameters that were held at their nominal values."""
    return [parameter.label for parameter, stored in _pairs(model) if stored.prior_sigma <= 0.0]


def _pairs(model: ModelFile) -> list[tuple[Parameter, StoredParameter]]:
    return list(zip(model.robot_model().parameters, model.parameters, strict=True))


def _row(robot: RobotFile, parameter: Parameter, stored: StoredParameter) -> ParameterRow:
    factor = parameter.unit.factor
    sigma = stored.sigma * factor
    return ParameterRow(
        symbol=parameter.label,
        unit=parameter.unit.shown,
        nominal=f"{table_value(robot, parameter):.8g}".replace("-", MINUS),
        deviation=with_sigma(stored.value * factor, sigma),
        tolerance=significant(stored.prior_sigma * factor),
        prior_share=(stored.sigma / stored.prior_sigma) ** 2,
        wide=abs(stored.value) > 3.0 * stored.prior_sigma,
    )


def table_value(robot: RobotFile, parameter: Parameter) -> float:
    """What the robot file says of a parameter, mm or degrees; 0 for what it does not hold (an effect, an axis)."""
    if parameter.group in ("base", "tool"):
        place = robot.tool if parameter.group == "tool" else robot.base
        return (*place.xyz, *place.abc)[_FRAME.index(parameter.axis)]
    if not parameter.column or parameter.joint > len(robot.links):
        return 0.0
    return float(getattr(robot.links[parameter.joint - 1], parameter.column) or 0.0)
