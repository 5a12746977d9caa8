"""The arrays of a correction model: names, sizes, and their order in memory. Lengths mm, angles rad, along the base.

The engine derives them from an identified robot; the process turns them into corrections. See `CorrectionModel` of
`cellctl.devices` for the meaning of each.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from drivers.kuka_rsi.axes import AXES

FORMAT = 1

MOST_VALUES = 16_384
"""Numbers of a model; 288 waves and 448 nodes need 8200."""

_LARGEST = 1e9
_HEAD = 3
"""Format, waves, nodes: in front of the arrays."""


def sizes(waves: int, nodes: int) -> dict[str, int]:
    """Count of numbers of each array, by its name, in the order in memory."""
    return {
        "sign": AXES,
        "offset": AXES,
        "base": 16,
        "links": 16 * (AXES + 1),
        "tool": 16,
        "identified": 16 * (AXES + 1),
        "identified_base": 9,
        "down": 3,
        "weight": 2 * AXES * AXES,
        "load": AXES,
        "load_place": 3,
        "bend": 1,
        "stretch": AXES + 1,
        "wave_joint": waves,
        "wave_order": waves,
        "wave_sine": waves,
        "wave_cosine": waves,
        "node_place": AXES * nodes,
        "node_scale": AXES * nodes,
        "node_weight": 3 * nodes,
        "lower": AXES,
        "upper": AXES,
        "fade": 1,
    }


def pack(arrays: Mapping[str, Sequence[float]]) -> tuple[float, ...]:
    """The numbers of a model in the order in memory. Raises ValueError for arrays that are not those of a model."""
    waves, nodes = len(arrays.get("wave_joint", ())), len(arrays.get("node_weight", ())) // 3
    expected, given = sizes(waves, nodes), {name: len(values) for name, values in arrays.items()}
    if given != expected:
        wrong = sorted(name for name in given.keys() | expected.keys() if given.get(name) != expected.get(name))
        raise ValueError(f"a correction model for {AXES} axes has other arrays: {', '.join(wrong)}")
    values = (float(FORMAT), float(waves), float(nodes), *(v for name in expected for v in arrays[name]))
    if problem := _problem(values):
        raise ValueError(problem)
    return values


def unpack(values: Sequence[float]) -> dict[str, Sequence[float]]:
    """The arrays in `values`, by name. Raises ValueError where `pack` did not make them."""
    problem = _problem(values)
    if problem or len(values) < _HEAD or values[0] != FORMAT:
        raise ValueError(problem or "no correction model of this format")
    found, start = {}, _HEAD
    for name, size in sizes(int(values[1]), int(values[2])).items():
        found[name] = values[start : start + size]
        start += size
    if start != len(values):
        raise ValueError(f"a correction model of {start} numbers has {len(values)}")
    return found


def _problem(values: Sequence[float]) -> str:
    if len(values) > MOST_VALUES:
        return f"a correction model of {len(values)} numbers (at most {MOST_VALUES})"
    if not all(map(math.isfinite, values)) or max(map(abs, values), default=0.0) > _LARGEST:
        return "a correction model with a number that is not finite or beyond all measure"
    return ""
