"""Limits of an on-line correction, and the motion of the correction within them: a rate and an acceleration."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self, final

from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.limits import Correction, Limit, ceiling_errors

_SLACK = 1e-6
_LONGEST_CYCLE_S = 0.012
_DEFAULTS = {"online_correction_deg": 0.5, "online_rate_deg_s": 0.5, "online_acceleration_deg_s2": 5.0}
ONLINE_CEILINGS = {"online_correction_deg": 2.0, "online_rate_deg_s": 2.0, "online_acceleration_deg_s2": 20.0}
"""Correction: a larger error is no calibration error. Rate and acceleration: those of a search by default."""


@final
@dataclass(frozen=True, slots=True)
class OnlineLimits:
    """Raises ValueError for a limit that is not positive, or above its ceiling.

    `online_correction_deg`: of each axis; `online_rate_deg_s`, `online_acceleration_deg_s2`: of the Euclidean norm of
    the correction's change, per second.
    """

    online_correction_deg: float = _DEFAULTS["online_correction_deg"]
    online_rate_deg_s: float = _DEFAULTS["online_rate_deg_s"]
    online_acceleration_deg_s2: float = _DEFAULTS["online_acceleration_deg_s2"]

    def __post_init__(self) -> None:
        settings = {name: getattr(self, name) for name in ONLINE_CEILINGS}
        if found := online_limit_errors(settings):
            raise ValueError("; ".join(found.values()))

    @classmethod
    def from_settings(cls, settings: dict[str, float]) -> Self:
        """From the cell file's limits; the others have low defaults. Raises ValueError with every error."""
        if found := online_limit_errors(settings):
            raise ValueError("; ".join(found.values()))
        return cls(**settings)

    def asked_deg(self, cycle_s: float) -> float:
        """The largest correction that is asked for: less than the limit by what a change of direction may overshoot."""
        overshoot = _overshoot_deg(self.online_rate_deg_s, self.online_acceleration_deg_s2, cycle_s)
        return self.online_correction_deg - overshoot


def of_each(settings: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """The limits of a search, and those of an on-line correction, among the cell file's."""
    online = {name: value for name, value in settings.items() if name in ONLINE_CEILINGS}
    return {name: value for name, value in settings.items() if name not in online}, online


def online_limit_errors(settings: dict[str, float]) -> dict[str, str]:
    """The error of each of these limits, by its name; empty without errors."""
    if wrong := ceiling_errors(settings, ONLINE_CEILINGS):
        return wrong
    values = _DEFAULTS | settings
    overshoot = _overshoot_deg(values["online_rate_deg_s"], values["online_acceleration_deg_s2"], _LONGEST_CYCLE_S)
    if overshoot <= values["online_correction_deg"] / 4:
        return {}
    what = f"the correction stops within {overshoot:.3g} deg only, over a quarter of its limit"
    return {next(iter(settings)): f"{what}: give a lower online_rate_deg_s or a higher acceleration"}


def _overshoot_deg(rate: float, acceleration: float, cycle_s: float) -> float:
    return rate * rate / (2 * acceleration) + 2 * rate * cycle_s


@final
class CorrectionMotion:
    """The correction that is sent, cycle by cycle: it follows what is wanted as fast as the limits allow.

    What is wanted and changes slowly is followed without a lag. `limited`: whether the last step fell short of it.
    """

    def __init__(self, limits: OnlineLimits, cycle_s: float) -> None:
        self.sent: Correction = (0.0,) * AXES
        self.limited = False
        self._step: Correction = (0.0,) * AXES
        self._most = limits.online_correction_deg
        self._step_most = limits.online_rate_deg_s * cycle_s
        self._bend_most = limits.online_acceleration_deg_s2 * cycle_s**2

    def stood(self) -> None:
        """The controller held the last correction: the next step begins at standstill."""
        self._step = (0.0,) * AXES

    @property
    def stands(self) -> bool:
        """Whether the last step was none."""
        return not any(self._step)

    def follow(self, wanted: Sequence[float]) -> Limit:
        """One step towards `wanted`, deg; no step and the limit's name where it would pass a limit."""
        step = self._bounded(self._towards(wanted))
        correction = tuple(at + by for at, by in zip(self.sent, step, strict=True))
        passed = self._passed(correction, step)
        if passed is Limit.NONE:
            self.sent, self._step = correction, step
            self.limited = math.dist(correction, wanted) > 1e-4
        else:
            self.stood()
        return passed

    def _towards(self, wanted: Sequence[float]) -> Correction:
        """The step to `wanted`, not longer than the rate allows, and than it can brake before it gets there."""
        away = tuple(to - at for to, at in zip(wanted, self.sent, strict=True))
        distance = math.hypot(*away)
        if not distance:
            return away
        brakes = max(math.sqrt(2 * self._bend_most * distance) - self._bend_most / 2, self._bend_most / 2)
        share = min(distance, self._step_most, brakes) / distance
        return tuple(share * axis for axis in away)

    def _bounded(self, step: Correction) -> Correction:
        """`step`, as far as the acceleration allows from the last one."""
        bend = tuple(a - b for a, b in zip(step, self._step, strict=True))
        size = math.hypot(*bend)
        if size <= self._bend_most:
            return step
        return tuple(b + self._bend_most / size * by for b, by in zip(self._step, bend, strict=True))

    def _passed(self, correction: Correction, step: Correction) -> Limit:
        if not max(map(abs, correction)) <= self._most * (1 + _SLACK):
            return Limit.CORRECTION
        if not math.hypot(*step) <= self._step_most * (1 + _SLACK) + 1e-12:
            return Limit.SPEED
        if not math.dist(step, self._step) <= self._bend_most * (1 + _SLACK) + 1e-12:
            return Limit.ACCELERATION
        return Limit.NONE


def within(wanted: Sequence[float], most_deg: float) -> tuple[tuple[float, ...], bool]:
    """`wanted`, all axes in proportion, so that none is beyond `most_deg`; and whether it was."""
    largest = max(map(abs, wanted))
    if largest <= most_deg:
        return tuple(wanted), False
    return tuple(axis * most_deg / largest for axis in wanted), True
