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
_LONGEST_MM = 1e5
"""Of a step between frames: with longer ones the Newton step loses its digits."""

_HIGHEST_ORDER = 1000
"""Of a wave, per turn of its joint."""

_ROUNDING = 1e-6
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
    values = (float(FORMAT), float(waves), float(nodes), *(float(v) for name in expected for v in arrays[name]))
    unpack(values)
    return values


def unpack(values: Sequence[float]) -> dict[str, Sequence[float]]:
    """The arrays in `values`, by name. Raises ValueError where `pack` did not make them, or they are no robot's."""
    if len(values) > MOST_VALUES:
        raise ValueError(f"a correction model of {len(values)} numbers (at most {MOST_VALUES})")
    if not all(map(math.isfinite, values)) or max(map(abs, values), default=0.0) > _LARGEST:
        raise ValueError("a correction model with a number that is not finite or beyond all measure")
    if len(values) < _HEAD or values[0] != FORMAT or not _whole(values[1:_HEAD], 0, MOST_VALUES):
        raise ValueError("no correction model of this format")
    found, start = {}, _HEAD
    for name, size in sizes(int(values[1]), int(values[2])).items():
        found[name] = values[start : start + size]
        start += size
    if start != len(values):
        raise ValueError(f"a correction model of {start} numbers has {len(values)}")
    if wrong := _impossible(found):
        raise ValueError(f"a correction model with an impossible {wrong}")
    return found


def _impossible(arrays: Mapping[str, Sequence[float]]) -> str:
    """The first array that is no robot's, in words; empty without one. The compiled step relies on them."""
    for name in ("base", "links", "tool", "identified"):
        frames = arrays[name]
        if not all(_is_frame(frames[at : at + 16]) for at in range(0, len(frames), 16)):
            return f"{name} (a frame is a rotation and at most {_LONGEST_MM:g} mm)"
    if not _is_rotation(arrays["identified_base"]):
        return "identified_base (no rotation)"
    if not all(abs(sign) == 1 for sign in arrays["sign"]):
        return "sign (1 or -1)"
    if not _whole(arrays["wave_joint"], 0, AXES - 1):
        return f"wave_joint (0 to {AXES - 1})"
    if not _whole(arrays["wave_order"], 1, _HIGHEST_ORDER):
        return f"wave_order (1 to {_HIGHEST_ORDER})"
    if not all(low <= high for low, high in zip(arrays["lower"], arrays["upper"], strict=True)):
        return "region (lower above upper)"
    return "" if arrays["fade"][0] > 0 else "fade (not positive)"


def _whole(values: Sequence[float], least: int, most: int) -> bool:
    return all(least <= value <= most and value == int(value) for value in values)


def _is_frame(matrix: Sequence[float]) -> bool:
    """Of 16 numbers, row by row."""
    turn = [matrix[at + k] for at in (0, 4, 8) for k in range(3)]
    near = max(abs(matrix[at]) for at in (3, 7, 11)) <= _LONGEST_MM
    return near and tuple(matrix[12:]) == (0, 0, 0, 1) and _is_rotation(turn)


def _is_rotation(matrix: Sequence[float]) -> bool:
    """Of 9 numbers, row by row: each row is the cross product of the other two, and the first is a unit."""
    x, y, z = matrix[:3], matrix[3:6], matrix[6:]
    made = (*_cross(y, z), *_cross(z, x), *_cross(x, y))
    unit = abs(math.hypot(*x) - 1) <= _ROUNDING
    return unit and all(abs(a - b) <= _ROUNDING for a, b in zip(matrix, made, strict=True))


def _cross(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
