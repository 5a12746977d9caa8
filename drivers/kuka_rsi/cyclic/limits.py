"""Limits of a search and of an on-line correction, checked before they start and in every cycle.

RSI bypasses the controller's path planning: the drives get each set-point as it is, and 1° in one cycle of 12 ms is 83
deg/s. So these limits are the last ones before the drives. c_k is the correction (6,) of cycle k, T the cycle;
differences are means of derivatives over the cycles, so that a path within the limits passes, and one outside does
not:

    speed         ‖c_k − c_{k−1}‖ ≤ v T
    acceleration  ‖c_k − 2 c_{k−1} + c_{k−2}‖ ≤ a T²
    jerk          ‖c_k − 3 c_{k−1} + 3 c_{k−2} − c_{k−3}‖ ≤ j T³

with Euclidean norms over the axes. A TCP at reach L moves by at most L Σ|ω_i| ≤ L √3 ‖ω‖ by the three main axes: that
turns 250 mm/s of ISO 10218-1 into the ceiling of v.

The on-line correction follows what is wanted, w, at most as fast as it can still brake before it. Standing d away, a
step s with deceleration b = a T² a cycle needs s²/2b + s/2 to stop: s ≤ √(2 b d) − b/2 in good approximation. When w
turns back, the correction overshoots by v²/2a + 2 v T at most (the way to brake, one cycle until it is noticed, one by
the steps of T); as much is kept free below the limit (`asked_deg`).

Degrees are those of the axes A1…A6 as the controller counts them; a norm over axes of different gears is no physical
quantity, only a bound of each of them and of the TCP.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from operator import sub
from typing import Self, final

from drivers.kuka_rsi import AXES

Correction = tuple[float, ...]
"""Offset of A1…A6 from the pose at RSI_ON, degrees."""

_SLACK = 1e-6
"""Relative slack for rounding in differences of nearly equal numbers."""

TCP_SPEED_MM_S = 250.0
"""ISO 10218-1: maximum TCP speed, mm/s, at reduced speed, which a person beside the robot can avoid."""

_MAIN_AXES = 3
"""Axes that move the TCP at full reach. A joint vector of norm w then moves it at w × reach × sqrt(3) at most.

This covers the wrist too: A2 and A3 are nearer to the TCP than the reach, by more than the wrist's levers add (all
postures tested of the shipped six-axis robots, decision 20).
"""

UNKNOWN_REACH_MM = 3900.0
"""Used if the reach is unknown: the longest of KUKA's six-axis arms. A longer arm has lower ceilings."""

SHORTEST_REACH_MM = 500.0
"""A shorter reach counts as this one: this bounds the ceilings for a robot file with a missing link."""

_SPEED_RAMP_S = 0.1
"""Least time from standstill to 250 mm/s: 2.5 m/s² at the TCP, a quarter of g, safe for any tool or grip."""

_ACCELERATION_RAMP_S = 0.04
"""Least time to the full acceleration: ten telegrams of 4 ms. A shorter ramp is a step to the drives, and excites
an arm's lowest resonance (10 to 25 Hz)."""

_AXISCORR_DEG = 5.0
"""AXISCORR's default limit of an axis (RSI itself stops at 6). Touches are planned with at most
4.5 deg, so no search needs more; a longer one is an error."""

SEARCH_NEEDS = {"speed_deg_s": 2.5, "acceleration_deg_s2": 20.0, "jerk_deg_s3": 400.0}
"""What the shipped searches need. Speed: 10 mm/s at the TCP, the most that the procedures offer, on a line of 18 mm and
at most 4.5 deg. With this acceleration and jerk, that speed is reached within 1 mm of the 10 mm before the surface."""

_LONGEST_CYCLE_S = 0.012
"""IPO: the check before the run does not know the cycle, and the longer one overshoots more."""

_DEFAULTS = {"online_correction_deg": 0.5, "online_rate_deg_s": 0.5, "online_acceleration_deg_s2": 5.0}
ONLINE_CEILINGS = {"online_correction_deg": 2.0, "online_rate_deg_s": 2.0, "online_acceleration_deg_s2": 20.0}
"""Correction: a larger error is no calibration error. Rate and acceleration: those of a search by default. `_DEFAULTS`:
a quarter of each. 0.5 deg/s is 59 mm/s at the TCP of the longest arm; at 100 deg/s a model's correction changes by 25.

They do not depend on the reach: 2 deg/s is at most 236 mm/s at the TCP of the longest arm (`UNKNOWN_REACH_MM`). This
motion comes on top of the program's own.
"""


class Limit(IntEnum):
    """Which limit was passed."""

    NONE = 0
    CORRECTION = 1
    TRAVEL = 2
    SPEED = 3
    ACCELERATION = 4
    JERK = 5


def ceilings(reach_mm: float | None) -> dict[str, float]:
    """The highest value of each limit of a search, by its name; hundredths, rounded down.

    `reach_mm`: the TCP's greatest distance from the first axis, None if unknown.
    """
    reach = max(reach_mm or UNKNOWN_REACH_MM, SHORTEST_REACH_MM)
    speed = math.degrees(TCP_SPEED_MM_S / (reach * math.sqrt(_MAIN_AXES)))
    acceleration = speed / _SPEED_RAMP_S
    highest = {
        "correction_deg": _AXISCORR_DEG,
        "speed_deg_s": speed,
        "acceleration_deg_s2": acceleration,
        "jerk_deg_s3": acceleration / _ACCELERATION_RAMP_S,
        "travel_deg": _AXISCORR_DEG,
    }
    return {name: math.floor(value * 100) / 100 for name, value in highest.items()}


@final
@dataclass(frozen=True, slots=True)
class SearchLimits:
    """The limits of a search. Raises ValueError for a limit that is not positive or above its ceiling.

    `correction_deg`: of each axis, from the pose at RSI_ON; `travel_deg`: of the Euclidean norm of the joint vector;
    `speed_deg_s`, `acceleration_deg_s2`, `jerk_deg_s3`: derivatives of that path length. The stop on contact has a
    deceleration of its own, see `CycleWatch`. `reach_mm`: of the arm, which the ceilings follow from.
    """

    correction_deg: float = 5.0
    speed_deg_s: float = 2.0
    acceleration_deg_s2: float = 20.0
    jerk_deg_s3: float = 400.0
    travel_deg: float = 5.0
    reach_mm: float = UNKNOWN_REACH_MM

    def __post_init__(self) -> None:
        settings = {name: getattr(self, name) for name in LIMIT_NAMES}
        if found := limit_errors(settings, self.reach_mm):
            raise ValueError("; ".join(found.values()))

    @classmethod
    def from_settings(cls, settings: dict[str, float], reach_mm: float | None = None) -> Self:
        """Limits from the cell file; the others have low defaults, at most their ceilings.

        `reach_mm`: of the arm, None if unknown. Raises ValueError with every error.
        """
        if found := limit_errors(settings, reach_mm):
            raise ValueError("; ".join(found.values()))
        low, highest = cls(), ceilings(reach_mm)
        values = {name: settings.get(name, min(getattr(low, name), highest[name])) for name in LIMIT_NAMES}
        return cls(**values, reach_mm=reach_mm or UNKNOWN_REACH_MM)

    def passed_by(self, correction: Correction, speed_deg_s: float) -> list[str]:
        """The limits that a search to `correction` at `speed_deg_s` would exceed, as text; empty if allowed."""
        largest, travel = max(map(abs, correction)), math.hypot(*correction)
        asked = {"correction_deg": largest, "travel_deg": travel, "speed_deg_s": speed_deg_s}
        return [
            f"{name} {value:.4g} (at most {getattr(self, name):g})"
            for name, value in asked.items()
            if not value <= getattr(self, name) * (1 + _SLACK)
        ]


LIMIT_NAMES = tuple(ceilings(None))
"""The limits that a cell file may set."""


def limit_errors(settings: dict[str, float], reach_mm: float | None) -> dict[str, str]:
    """The error of each of these limits, by its name; empty without errors. `reach_mm` as in `ceilings`."""
    return ceiling_errors(settings, ceilings(reach_mm), lambda name: f" ({_reason(name, reach_mm)})")


def ceiling_errors(
    settings: Mapping[str, float], highest: Mapping[str, float], reason: Callable[[str], str] = lambda _: ""
) -> dict[str, str]:
    """The error of each of these limits, by its name; empty without errors.

    `highest`: ceiling of each known limit; `reason`: why a limit has its ceiling, as the end of the text.
    """
    checked = {name: _limit_error(name, value, highest, reason) for name, value in settings.items()}
    return {name: what for name, what in checked.items() if what}


def _limit_error(name: str, value: float, highest: Mapping[str, float], reason: Callable[[str], str]) -> str:
    if name not in highest:
        return f"unknown robot limit {name}"
    if not (math.isfinite(value) and value > 0):
        return f"a robot limit must be a positive number ({name}: {value})"
    if value <= highest[name]:
        return ""
    return f"robot limit {name}: {value:g} is above the ceiling of {highest[name]:g}{reason(name)}"


def _reason(name: str, reach_mm: float | None) -> str:
    if name in ("correction_deg", "travel_deg"):
        return "what AXISCORR allows; no search needs more"
    reach = f"a reach of {reach_mm:.0f} mm" if reach_mm else f"an unknown reach, taken as {UNKNOWN_REACH_MM:.0f} mm"
    reasons = {
        "speed_deg_s": f"{TCP_SPEED_MM_S:g} mm/s at the TCP",
        "acceleration_deg_s2": f"{TCP_SPEED_MM_S:g} mm/s at the TCP after {_SPEED_RAMP_S:g} s",
        "jerk_deg_s3": f"full acceleration after {_ACCELERATION_RAMP_S:g} s",
    }
    return f"{reasons[name]}, with {reach}"


@final
class CycleWatch:
    """Checks each correction before it is sent, against the three sent before it.

    It is a second check, of the profile's own limits (`SetPoint`): a refusal is an error of this program, and the
    correction that was sent last is repeated. That is a stop within one cycle, which is not limited here, since a lost
    answer does the same at any time.

    Differences of a set-point sampled every cycle are means of its derivatives, so a path within the limits passes and
    one outside does not. Braking is allowed `speed_deg_s` / (2 × cycle) and any jerk: standstill in
    the second telegram requires that (2 deg/s at 4 ms: 250 deg/s²; 5 deg/s: 625 deg/s²).
    """

    def __init__(self, limits: SearchLimits, cycle_s: float) -> None:
        self._limits = limits
        self._cycle_s = cycle_s
        self._sent: deque[Correction] = deque([(0.0,) * AXES] * 3, maxlen=3)

    def look(self, correction: Correction, *, braking: bool = False) -> Limit:
        """The first limit that sending `correction` now would pass; it counts as sent only if there is none."""
        passed = self._place(correction) or self._motion(correction, braking)
        if passed is Limit.NONE:
            self._sent.append(correction)
        return passed

    def stood(self) -> None:
        """The controller held the last correction for a while: the robot has come to a stop."""
        self._sent.extend([self._sent[-1]] * 3)

    def _place(self, correction: Correction) -> Limit:
        if not max(map(abs, correction)) <= self._limits.correction_deg * (1 + _SLACK):
            return Limit.CORRECTION
        return Limit.NONE if math.hypot(*correction) <= self._limits.travel_deg * (1 + _SLACK) else Limit.TRAVEL

    def _motion(self, correction: Correction, braking: bool) -> Limit:
        limits, dt = self._limits, self._cycle_s
        a, b, c = self._sent
        steps = [_minus(correction, c), _minus(c, b), _minus(b, a)]
        bends = [_minus(steps[0], steps[1]), _minus(steps[1], steps[2])]
        acceleration = limits.speed_deg_s / (2 * dt) if braking else limits.acceleration_deg_s2
        if not _size(steps[0]) <= limits.speed_deg_s * dt:
            return Limit.SPEED
        if not _size(bends[0]) <= acceleration * dt**2:
            return Limit.ACCELERATION
        if not braking and not _size(_minus(*bends)) <= limits.jerk_deg_s3 * dt**3:
            return Limit.JERK
        return Limit.NONE


def _minus(a: Correction, b: Correction) -> Correction:
    return tuple(map(sub, a, b))


def _size(vector: Correction) -> float:
    # 1e-12 deg is above the rounding of a third difference of corrections up to 5 deg (1e-14), and far below the
    # smallest limit, of the jerk in a cycle of 4 ms (2.6e-5 deg at 400 deg/s³)
    return math.hypot(*vector) * (1 - _SLACK) - 1e-12


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
    if overshoot <= values["online_correction_deg"] / 4:  # `asked_deg` is then three quarters of the limit at least
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
            self.limited = math.dist(correction, wanted) > 1e-4  # deg: the last decimal of a telegram at Precision 4
        else:
            self.stood()
        return passed

    def _towards(self, wanted: Sequence[float]) -> Correction:
        """The step to `wanted`, not longer than the rate allows, and than it can brake before it gets there."""
        away = tuple(to - at for to, at in zip(wanted, self.sent, strict=True))
        distance = math.hypot(*away)
        if not distance:
            return away
        # d = s²/2b + s/2 solved for s, less than b/2 on the safe side; never below b/2, else it would not arrive
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
