"""The uncertainty budget, the decision on an acceptance limit by it, and the table that explains every σ of a page.

Type A: from the statistics of this run; type B: from other knowledge (JCGM 100:2008, 4.2 and 4.3).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal, Self, final

from cellctl.formats.measurements import KINDS

NOT_STATED = "not stated"

COVERAGE = {1: 1.96, 3: 1.61}
"""95 % of normal errors along a line are within 1.96 σ; of isotropic ones in space, within 1.61 times their 3-D RMS."""


@final
@dataclass(frozen=True, slots=True)
class Contribution:
    """A contribution: its name, type, source, and standard uncertainties, mm; None where it does not contribute.

    error_mm: to a measured error. position_mm: to a position of the TCP by the identified model, 3-D. instead: shown
    where both are None. shared: all measured errors have it in common, so their scatter does not show it.
    """

    what: str
    kind: Literal["A", "B"]
    source: str
    error_mm: float | None = None
    position_mm: float | None = None
    instead: str = NOT_STATED
    shared: bool = True

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
    """The contributions; dimensions: 1 if errors are measured along a line (touches), else 3.

    radius_95: coverage factor of a position; larger than 1.61 where its σ has few degrees of freedom.
    """

    contributions: tuple[Contribution, ...]
    dimensions: int
    radius_95: float = COVERAGE[3]

    @classmethod
    def of(cls, contributions: Iterable[Contribution], dimensions: int, radius_95: float = COVERAGE[3]) -> Self:
        """These contributions, type A first."""
        return cls(tuple(sorted(contributions, key=lambda each: each.kind)), dimensions, radius_95)

    @property
    def error_mm(self) -> float:
        """The combined standard uncertainty of a measured error."""
        return math.hypot(*(each.error_mm or 0.0 for each in self.contributions))

    @property
    def shared_mm(self) -> float:
        """The part of it that all measured errors have in common."""
        return math.hypot(*(each.error_mm or 0.0 for each in self.contributions if each.shared))

    @property
    def position_mm(self) -> float:
        """The combined standard uncertainty of a position of the TCP, 3-D."""
        return math.hypot(*(each.position_mm or 0.0 for each in self.contributions))

    @property
    def factors(self) -> tuple[float, float]:
        """The coverage factors for 95 %: of a measured error, of a position."""
        return COVERAGE[self.dimensions], self.radius_95

    @property
    def expanded_mm(self) -> tuple[float, float]:
        """The expanded uncertainties, 95 %: of a measured error, of a position."""
        of_error, of_position = self.factors
        return of_error * self.error_mm, of_position * self.position_mm

    @property
    def missing(self) -> Sequence[str]:
        """What is not stated, so not contained."""
        return [each.what for each in self.contributions if not each.stated]


def _numbers_of(measure: str) -> int:
    """Measured numbers of a row, by what it measures; several kinds count as points."""
    return KINDS[measure].numbers if measure in KINDS else 3


def dimensions_of(measure: str) -> int:
    """1 for measurements along a line, 3 for points."""
    return 1 if _numbers_of(measure) == 1 else 3


def scatter_of_fit(measure: str, rms_mm: float, rows: int, rank: int) -> tuple[float, int] | None:
    """The scatter of a single measurement from the residuals of a fit, mm, and its degrees of freedom.

    s = rms · √(N / (N − rank)) of N measured numbers. None where there are no more numbers than observable parameters.
    """
    numbers = rows * _numbers_of(measure)
    free = numbers - rank
    return (rms_mm * math.sqrt(numbers / free), free) if free > 0 else None


@final
@dataclass(frozen=True, slots=True)
class Sigma:
    """A σ by its name on the page: its contents, its computation, and its level (1 σ, or the share covered)."""

    name: str
    covers: str
    how: str
    level: str


FIGURES = (
    Sigma("mean ± u", "the mean of n errors", "s/√n from the scatter s of the errors", "1 σ"),
    Sigma(
        "predicted, in the table of errors",
        "the RMS error of the same rows: model and measurement together",
        "from the covariance of the parameters and the σ of the rows",
        "1 σ; of points and poses 3-D",
    ),
)
"""Those of the table of errors at the top of a page."""

IDENTIFICATION = (
    Sigma(
        "assumed σ",
        "one parameter, before the data: how far such robots are from their nominal values",
        "robot file, default, or the covariance of the prior model",
        "1 σ",
    ),
    Sigma(
        "deviation ± σ",
        "one parameter, after the data",
        "covariance of the fit, from the rows and the assumed σ; scaled by the scatter that was found",
        "1 σ",
    ),
    Sigma(
        "σ of X, Y, Z, a zero, an offset",
        "one coordinate of a base, tool, sphere or socket; one length",
        "covariance of the fit",
        "1 σ for each coordinate",
    ),
    Sigma(
        "σ of A, B, C, of a tilt",
        "the rotation as a whole",
        "root of the sum of the variances about the axes",
        "1 σ, all axes together",
    ),
    Sigma(
        "1 σ of the TCP; 1 σ over the joints, in the verdict",
        "the position that the model predicts, as `cellctl predict` states it; without the scatter of a measurement",
        "root of the sum of the three variances of X, Y, Z: covariance of the parameters, open variance of the "
        "residual models, scatter of errors too fast for the model, doubt outside the measured joints",
        "1 σ, 3-D. Not 95 %: if alike in all directions, 95 % of the errors are within 1.61 times this value; within "
        "more where rows at fixed points show that the model lacks something",
    ),
    Sigma(
        "σ after, in the table of postures",
        "the same, of points among themselves, with that posture and those above it measured",
        "covariance that the fit would have then; the rest as above",
        "1 σ, 3-D",
    ),
    Sigma(
        "predicted σ of a residual",
        "one number of a row: measurement and model for held-out rows, measurement less model for rows of the fit",
        "σ² + JCJᵀ for held-out rows, σ² − JCJᵀ for rows of the fit",
        "1 σ; ±1.96 σ is 95 % of one number",
    ),
    Sigma(
        "95 % region of a held-out row",
        "all numbers of the row together",
        "interval or ellipsoid of the same covariance, with the tails that folds of the fit's rows show",
        "95 %",
    ),
    Sigma(
        "mean of neighbouring rows ± 2 standard errors",
        "the line in the pictures of residuals",
        "from the scatter of the rows in a bin",
        "2 σ, about 95 %",
    ),
    Sigma(
        "gain ± standard error; drift ± standard error",
        "a difference between two models; a slope over the rows",
        "from the scatter of the paired errors; of the residuals about the line",
        "1 σ",
    ),
)
"""Those of the sections about an identification."""
