"""Points that fill a cube evenly: Sobol' and Halton sequences of SciPy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scipy.stats.qmc import Halton, Sobol


def sobol(dimensions: int, **settings: Any) -> Sobol:
    """A sampler of a Sobol' sequence; settings: of `scipy.stats.qmc.Sobol`."""
    from scipy.stats import qmc  # at first use: scipy.stats takes 0.4 s

    return qmc.Sobol(dimensions, **settings)


def halton(dimensions: int, **settings: Any) -> Halton:
    """A sampler of a Halton sequence; settings: of `scipy.stats.qmc.Halton`."""
    from scipy.stats import qmc  # at first use: scipy.stats takes 0.4 s

    return qmc.Halton(dimensions, **settings)
