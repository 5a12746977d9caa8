"""Points that fill a cube evenly: Sobol' and Halton sequences of SciPy."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cellctl.kinematics._frames import Floats

if TYPE_CHECKING:
    from scipy.stats.qmc import Halton, Sobol


def sobol(dimensions: int, **settings: Any) -> Sobol:
    """A sampler of a Sobol' sequence; settings: of `scipy.stats.qmc.Sobol`."""
    sampler: Sobol = _qmc().Sobol(dimensions, **settings)
    return sampler


def spread_over(lower: Floats, upper: Floats, count: int, **settings: Any) -> Floats:
    """Postures (count, n) spread evenly over the box lower (n,) … upper (n,); count: a power of two, else the sequence
    loses its balance. settings: of `sobol`; scramble=False gives the same postures each time.
    """
    return np.asarray(lower + sobol(len(lower), **settings).random(count) * (upper - lower))


def evenly(dimensions: int, count: int) -> Floats:
    """Points (count, dimensions) of the unit cube, quasi-random (Sobol'; drawn in powers of two)."""
    drawn = sobol(dimensions, rng=np.random.default_rng(1)).random(1 << max(count - 1, 0).bit_length())
    return np.asarray(drawn[:count])


def halton(dimensions: int, **settings: Any) -> Halton:
    """A sampler of a Halton sequence; settings: of `scipy.stats.qmc.Halton`."""
    sampler: Halton = _qmc().Halton(dimensions, **settings)
    return sampler


def _qmc() -> Any:
    from scipy.stats import qmc  # at first use: scipy.stats takes 0.4 s

    return qmc
