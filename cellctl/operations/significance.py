"""Whether a change is above its σ."""

from __future__ import annotations

_COVERAGE = 2.0
"""Coverage factor k: a change above k σ is called significant; without a change 4.6 % are."""


def significant(change: float | None, sigma: float | None) -> bool | None:
    """Whether a change is above 2 σ; None where change or σ is not known."""
    return None if change is None or sigma is None else abs(change) > _COVERAGE * sigma


class ComparedNumber:
    """A number of a and of b, None where one has none, and 1 σ of their difference, None where it is not known."""

    __slots__ = ()
    a: float | None
    b: float | None
    sigma: float | None

    @property
    def difference(self) -> float | None:
        """b less a."""
        return None if self.a is None or self.b is None else self.b - self.a

    @property
    def significant(self) -> bool | None:
        """Whether the difference is above 2 σ; None without σ."""
        return significant(self.difference, self.sigma)
