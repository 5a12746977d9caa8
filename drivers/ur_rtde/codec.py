"""Packages of RTDE, protocol version 2: what this driver sends, and what a controller answers.

Source: Universal Robots, Real-Time Data Exchange (RTDE) Guide. Integers and floats are big-endian. A package is its
length (2 bytes, these included), its type (1 byte) and a payload. A recipe is a list of variables; the controller
answers it with their types, and a data package holds their values in the recipe's order, behind the recipe's number.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import final

PROTOCOL = 2
LARGEST_PACKAGE = 4096
"""What a controller sends at most, bytes."""

_HEADER = struct.Struct(">HB")

Value = int | float | bool | tuple[float, ...] | tuple[int, ...]

_FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}


@final
class Kind(IntEnum):
    """Package types, by the characters that stand for them."""

    REQUEST_PROTOCOL = ord("V")
    CONTROLLER_VERSION = ord("v")
    TEXT = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")


@final
@dataclass(frozen=True, slots=True)
class Package:
    """A package: its type and the bytes behind it."""

    kind: int
    payload: bytes


def packed(kind: Kind, payload: bytes = b"") -> bytes:
    """A package as it is sent."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


@final
class PackageStream:
    """Splits a stream into packages, for any TCP segmentation."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> Iterator[Package]:
        """The packages that `data` completes. Raises ValueError, behind those, for a length that no package has."""
        self._buffer += data
        while len(self._buffer) >= _HEADER.size:
            length, kind = _HEADER.unpack_from(self._buffer)
            if not _HEADER.size <= length <= LARGEST_PACKAGE:
                known = f"{_HEADER.size} … {LARGEST_PACKAGE} can be"
                raise ValueError(f"a package of {length} bytes is announced ({known})")
            if len(self._buffer) < length:
                return
            package, self._buffer = Package(kind, self._buffer[_HEADER.size : length]), self._buffer[length:]
            yield package


@final
@dataclass(frozen=True, slots=True)
class Recipe:
    """A recipe that the controller accepted: its number there, the variables, their types."""

    number: int
    names: tuple[str, ...]
    types: tuple[str, ...]

    @property
    def _layout(self) -> str:
        return ">B" + "".join(_FORMATS[kind] for kind in self.types)

    def pack(self, values: Mapping[str, Value]) -> bytes:
        """A data package with a value for every variable. Raises KeyError for a missing one, struct.error."""
        flat: list[int | float] = []
        for name in self.names:
            value = values[name]
            flat.extend(value if isinstance(value, tuple) else (value,))
        return packed(Kind.DATA, struct.pack(self._layout, self.number, *flat))

    def unpack(self, payload: bytes) -> dict[str, Value]:
        """The values in a data package. Raises ValueError if it is another recipe's, or of another length."""
        layout = struct.Struct(self._layout)
        if len(payload) != layout.size:
            raise ValueError(f"a data package of {len(payload)} bytes; the recipe has {layout.size}")
        number, *flat = layout.unpack(payload)
        if number != self.number:
            raise ValueError(f"a data package of recipe {number}; asked for is {self.number}")
        values: dict[str, Value] = {}
        for name, kind in zip(self.names, self.types, strict=True):
            count = int(found) if (found := _FORMATS[kind][:-1]) else 1
            values[name] = tuple(flat[:count]) if kind.startswith("VECTOR") else flat[0]
            del flat[:count]
        return values


def outputs_request(names: Sequence[str], frequency_hz: float) -> bytes:
    """A request for an output recipe, sent so many times a second."""
    return packed(Kind.OUTPUTS, struct.pack(">d", frequency_hz) + ",".join(names).encode("ascii"))


def inputs_request(names: Sequence[str]) -> bytes:
    """A request for an input recipe."""
    return packed(Kind.INPUTS, ",".join(names).encode("ascii"))


def recipe_of(names: Sequence[str], answer: bytes) -> Recipe:
    """The recipe in the controller's answer. Raises ValueError that names each variable which it did not give."""
    if not answer:
        raise ValueError("the answer to a recipe is empty")
    types = tuple(answer[1:].decode("ascii", "replace").split(","))
    if len(types) != len(names):
        raise ValueError(f"{len(names)} variables were asked for, the answer has {len(types)} types")
    missing = [name for name, kind in zip(names, types, strict=True) if kind == "NOT_FOUND"]
    taken = [name for name, kind in zip(names, types, strict=True) if kind == "IN_USE"]
    unknown = [kind for kind in types if kind not in (*_FORMATS, "NOT_FOUND", "IN_USE")]
    if missing:
        raise ValueError(f"the controller does not know {', '.join(missing)}")
    if taken:
        raise ValueError(f"another program writes {', '.join(taken)}")
    if unknown:
        raise ValueError(f"the controller states types that RTDE does not have: {', '.join(unknown)}")
    return Recipe(answer[0], tuple(names), types)


def text_of(payload: bytes) -> str:
    """The text of a message of the controller, with its source."""
    try:
        length = payload[0]
        text, rest = payload[1 : 1 + length], payload[1 + length :]
        source = rest[1 : 1 + rest[0]]
    except IndexError:
        return payload.decode("latin-1")
    return f"{text.decode('latin-1')} ({source.decode('latin-1')})"
