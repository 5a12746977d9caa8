"""Differences between two files, or two JSON values, and whether they are within the tolerance of another computer.

Linear algebra libraries choose their code by the processor. The order of their sums differs, so the last digits do, and
what is a rounding error of zero on one processor has any digits on another. Measured on campaigns and fits, between the
OpenBLAS kernels Nehalem, Haswell, Zen and SkylakeX: at most 1e-8 (mm, degrees). `ABSOLUTE` is ten times that, and far
below what a robot can do; without `RELATIVE` large numbers would differ by their 53 bits alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import zip_longest
from typing import Any, Final, Self, final

_EXCERPT: Final = 40
"""Number of bytes of a line that are shown from the difference on."""

_ABSENT: Final = object()

ABSOLUTE: Final = 1e-7
RELATIVE: Final = 1e-5
"""Two numbers are within the tolerance if they differ by no more than ABSOLUTE + RELATIVE × the larger of the two."""

TOLERANCE: Final = f"numbers agree to {ABSOLUTE:g} or {RELATIVE:g} of their size, all else is equal"

_TOKEN: Final = re.compile(r"(\b[0-9a-f]{64}\b|-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)")
"""A SHA-256 or a number; `re.split` puts these at the odd places."""


class Agreement(StrEnum):
    """How a replayed result agrees with the record."""

    EXACT = "equal to the byte"
    WITHIN_TOLERANCE = "equal within the stated tolerance (other processor or library)"
    DIFFERENT = "not equal"


def close(before: float, now: float) -> bool:
    """Whether two numbers are within the tolerance."""
    return math.isclose(before, now, rel_tol=RELATIVE, abs_tol=ABSOLUTE)


def same_within_tolerance(before: str, now: str) -> bool:
    """Whether two texts (JSON, CSV) differ in numbers within the tolerance alone.

    A SHA-256 stands for a content that is compared by itself, such as the model's in a table: another one is accepted
    where it takes the same place throughout.
    """
    hashes: dict[str, str] = {}
    for place, (one, other) in enumerate(zip_longest(_TOKEN.split(before), _TOKEN.split(now))):
        if one == other:
            continue
        if one is None or other is None or place % 2 == 0:
            return False
        if len(one) == len(other) == _SHA256:
            if hashes.setdefault(one, other) != other:
                return False
        elif not ({*".eE"} & {*one, *other}) or not close(float(one), float(other)):  # counts are equal, or not
            return False
    return True


_SHA256: Final = 64


@final
@dataclass(frozen=True, slots=True)
class FirstDifference:
    """The first byte (from 1) that differs and its line (from 1); the text from there on, before and now."""

    byte: int
    line: int
    before: str
    now: str

    @classmethod
    def of(cls, before: bytes, now: bytes) -> Self | None:
        """The first difference of `now` from `before`; None if they are equal."""
        if before == now:
            return None
        pairs = enumerate(zip(before, now, strict=False))
        at = next((place for place, (one, other) in pairs if one != other), min(len(before), len(now)))
        return cls(at + 1, before.count(b"\n", 0, at) + 1, _excerpt(before, at), _excerpt(now, at))

    def __str__(self) -> str:
        return f"first at byte {self.byte} (line {self.line}): {self.before} → {self.now}"


def _excerpt(content: bytes, at: int) -> str:
    """The text from `at` to the end of its line, shortened if long; a number is shown from its beginning."""
    while 0 < at < len(content) and content[at - 1 : at] in b"0123456789.-+e":
        at -= 1
    line = content[at : at + _EXCERPT].split(b"\n", 1)[0].decode("utf-8", "replace")
    return repr(line) if at < len(content) else "the end of the file"


def json_differences(before: Any, now: Any, place: str) -> list[str]:
    """All differences of `now` from `before`, each as `place.key[3]: old → new`, in order."""
    return list(_differences(before, now, place))


def _differences(before: Any, now: Any, place: str) -> Iterator[str]:
    match before, now:
        case dict(), dict():
            for key in sorted(before.keys() | now.keys()):
                inner = f"{place}.{key}"
                yield from _differences(before.get(key, _ABSENT), now.get(key, _ABSENT), inner)
        case list(), list():
            if len(before) != len(now):
                yield f"{place}: {len(before)} elements → {len(now)}"
            for index, (one, other) in enumerate(zip(before, now, strict=False)):
                yield from _differences(one, other, f"{place}[{index}]")
        case _ if type(before) is not type(now) or before != now:
            yield f"{place}: {_short(before)} → {_short(now)}"


def _short(value: Any) -> str:
    if value is _ABSENT:
        return "absent"
    text = repr(value)
    return text if len(text) <= 2 * _EXCERPT else f"{text[: 2 * _EXCERPT]}…"
