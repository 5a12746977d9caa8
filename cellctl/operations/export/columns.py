"""Names and units of a sample's columns: nested rows of the journal as flat ones."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, final

_JOINTS = ("joints", "resting", "commanded", "nominal", "at_target", "at_contact", "readings")
_PER_JOINT = (*_JOINTS, "direction", "amperes", "sigma_a")
"""Lists with an item for each joint: their columns end in A1 … An."""

_COORDINATES = ("xyz", "normal", "target", "covariance", "common")
"""Lists with an item for each of x, y, z."""

_UNITS = {
    **dict.fromkeys(_JOINTS, "deg"),
    **dict.fromkeys(("xyz", "target", "scatter"), "mm"),
    **dict.fromkeys(("covariance", "common"), "mm^2"),
    **dict.fromkeys(("amperes", "sigma_a"), "A"),
}
_SUFFIXES = {
    "mm": "mm", "deg": "deg", "rad": "rad", "ns": "ns", "ms": "ms", "s": "s", "c": "degC", "hpa": "hPa", "percent": "%",
}  # fmt: skip


@final
@dataclass(frozen=True, slots=True)
class Leaf:
    """A value of a row: the name of its column, its unit ("" if it has none), and the value."""

    name: str
    unit: str
    value: Any


def leaves(data: Mapping[str, Any]) -> Iterator[Leaf]:
    """The values of a journal row: `{"point": {"xyz": [1, 2, 3]}}` has `point_xyz_x`, `point_xyz_y`, `point_xyz_z`.

    Items of other lists are counted from 1.
    """
    for key, value in data.items():
        yield from _below(key, key, value)


def unit_of(field: str) -> str:
    """The unit of a field by its name, or by its ending (`shift_mm`); "" if it has none."""
    return _UNITS.get(field) or _SUFFIXES.get(field.rpartition("_")[2] if "_" in field else "", "")


def _below(name: str, field: str, value: Any) -> Iterator[Leaf]:
    match value:
        case dict():
            for key, inner in value.items():
                yield from _below(f"{name}_{key}", key, inner)
        case list() | tuple():
            for index, inner in enumerate(value):
                yield from _below(f"{name}_{_label(field, index)}", field, inner)
        case _:
            yield Leaf(name, unit_of(field), value)


def _label(field: str, index: int) -> str:
    if field in _PER_JOINT:
        return f"A{index + 1}"
    return "xyz"[index] if field in _COORDINATES and index < 3 else str(index + 1)
