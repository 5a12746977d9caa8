"""The cell file's `currents:`: which device has the motor currents, and scale and offset of each axis."""

from __future__ import annotations

from typing import Annotated, Literal, final

from pydantic import BaseModel, ConfigDict, Field

from cellctl.files import Document, InputError
from cellctl.files.validated import validated
from cellctl.formats.robot import Number

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
_Scale = Annotated[float, Field(allow_inf_nan=False)]


@final
class Currents(BaseModel):
    """`source`: the device; its currents of A1…An become scale × current + offset, amperes of the motor.

    The sources differ in unit and sign: MACur may be percent of a drive's maximum, 0x6078 is per mille of a rated
    current. No scale: 1; no offset: 0.
    """

    model_config = _STRICT
    source: Literal["drives", "robot"]
    scale: list[_Scale] = []
    offset: list[Number] = []

    def applied(self, values: tuple[float, ...]) -> tuple[float, ...]:
        """Currents of A1…An with scale and offset."""
        scale = self.scale or [1.0] * len(values)
        offset = self.offset or [0.0] * len(values)
        return tuple(a * value + b for a, value, b in zip(scale, values, offset, strict=True))

    def applied_sigma(self, sigmas: tuple[float, ...]) -> tuple[float, ...]:
        """1 σ of A1…An with scale."""
        scale = self.scale or [1.0] * len(sigmas)
        return tuple(abs(a) * sigma for a, sigma in zip(scale, sigmas, strict=True))


def currents_of(document: Document, axes: int) -> Currents:
    """The `currents:` of a loaded cell file, for a robot of `axes` axes. Raises InputError with every error."""
    currents = validated(document, Currents, ("currents",))
    problems = []
    devices = document.data.get("devices") or {}
    if currents.source not in devices:
        what = f"there is no device '{currents.source}'"
        problems.append(document.problem(("currents", "source"), what, f"one of {', '.join(devices)}"))
    for name, values in (("scale", currents.scale), ("offset", currents.offset)):
        if values and len(values) != axes:
            what = f"{len(values)} values for {axes} axes"
            problems.append(document.problem(("currents", name), what, "one for each axis, A1 first"))
    for index, value in enumerate(currents.scale):
        if value == 0.0:
            cure = "amperes of the motor per unit of the source"
            problems.append(document.problem(("currents", "scale", index), "a scale of 0 loses the current", cure))
    if problems:
        raise InputError(problems)
    return currents
