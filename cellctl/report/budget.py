"""The uncertainty budget: contributions of type A and B, combined, with the coverage of the result.

Type A: from the statistics of this run; type B: from other knowledge (JCGM 100:2008, 4.2 and 4.3).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, Self, final

NOT_STATED = "not stated"

_COVERAGE = {1: 1.96, 3: 1.61}
"""95 % of normal errors along a line are within 1.96 σ; of isotropic ones in space, within 1.61 times their 3-D RMS."""

_NUMBERS = {"position": 3, "pose": 6, "socket": 3, "sphere": 1, "plane": 1, "distance": 1}
"""Measured numbers of a row, by what it measures."""


@final
@dataclass(frozen=True, slots=True)
class Contribution:
    """A contribution: its name, type, source, and standard uncertainties, mm; None where it does not contribute.

    error_mm: to a measured error. position_mm: to a position of the TCP by the identified model, 3-D. instead: shown
    where both are None.
    """

    what: str
    kind: Literal["A", "B"]
    source: str
    error_mm: float | None = None
    position_mm: float | None = None
    instead: str = NOT_STATED

    @classmethod
    def of_errors(cls, what: str, kind: Literal["A", "B"], source: str, sigma_mm: float, dimensions: int) -> Self:
        """One that is in every measured error: sigma_mm along one line or in space. A position has it in space."""
        in_space = sigma_mm * math.sqrt(3.0) if dimensions == 1 else sigma_mm
        return cls(what, kind, source, sigma_mm, in_space)

    @property
    def stated(self) -> bool:
        """Whether the budget has it: as a number, or contained in another one."""
        return self.instead != NOT_STATED or not self.error_mm is self.position_mm is None


@final
@dataclass(frozen=True)
class Budget:
    """The contributions; dimensions: 1 if errors are measured along a line (touches), else 3."""

    contributions: tuple[Contribution, ...]
    dimensions: int

    @classmethod
    def of(cls, contributions: Iterable[Contribution], dimensions: int) -> Self:
        """These contributions, type A first."""
        return cls(tuple(sorted(contributions, key=lambda each: each.kind)), dimensions)

    @property
    def error_mm(self) -> float:
        """The combined standard uncertainty of a measured error."""
        return math.hypot(*(each.error_mm or 0.0 for each in self.contributions))

    @property
    def position_mm(self) -> float:
        """The combined standard uncertainty of a position of the TCP, 3-D."""
        return math.hypot(*(each.position_mm or 0.0 for each in self.contributions))

    @property
    def factors(self) -> tuple[float, float]:
        """The coverage factors for 95 %: of a measured error, of a position."""
        return _COVERAGE[self.dimensions], _COVERAGE[3]

    @property
    def expanded_mm(self) -> tuple[float, float]:
        """The expanded uncertainties, 95 %: of a measured error, of a position."""
        of_error, of_position = self.factors
        return of_error * self.error_mm, of_position * self.position_mm

    @property
    def missing(self) -> Sequence[str]:
        """What is not stated, so not contained."""
        return [each.what for each in self.contributions if not each.stated]


def dimensions_of(measure: str) -> int:
    """1 for measurements along a line, 3 for points."""
    return 1 if _NUMBERS.get(measure, 3) == 1 else 3


def scatter_of_fit(measure: str, rms_mm: float, rows: int, rank: int) -> tuple[float, int] | None:
    """The scatter of a single measurement from the residuals of a fit, mm, and its degrees of freedom.

    s = rms · √(N / (N − rank)) of N measured numbers. None where there are no more numbers than observable parameters.
    """
    numbers = rows * _NUMBERS.get(measure, 3)
    free = numbers - rank
    return (rms_mm * math.sqrt(numbers / free), free) if free > 0 else None
