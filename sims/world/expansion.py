"""Links that grow with their temperature, each by its own share of aluminium and steel."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sims.conditions import REFERENCE_C
from sims.world.errors import generator
from sims.world.nominal import Geometry, vector
from sims.world.screws import Axis

STEEL_PER_K = 1.2e-5
ALUMINIUM_PER_K = 2.3e-5


def expansions(links: int, seed: int, scale: float) -> list[float]:
    """Expansion of each link per kelvin."""
    drawn = generator(seed, "expansion").uniform(STEEL_PER_K, ALUMINIUM_PER_K, links)
    return [float(one) for one in scale * drawn]


def grown(cold: Geometry, per_kelvin: Sequence[float], temperature_c: float) -> Geometry:
    """The geometry at a temperature: from each axis the next one, or the flange, is farther by that link's expansion.

    What carries the first axis is the cell's floor: it does not grow. Neither do directions change, nor the tool.
    """
    kelvin = temperature_c - REFERENCE_C
    stations = [np.array(axis.point) for axis in cold.axes] + [cold.flange[:3, 3]]
    places = stations[:1]
    for (start, end), rate in zip(pairwise(stations), per_kelvin, strict=True):
        places.append(places[-1] + (1.0 + rate * kelvin) * (end - start))
    flange = cold.flange.copy()
    flange[:3, 3] = places[-1]
    axes = [Axis(vector(place), axis.direction) for place, axis in zip(places[:-1], cold.axes, strict=True)]
    return Geometry(tuple(axes), flange)
