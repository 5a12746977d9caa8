"""Differences between two files, or two JSON values."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Self, final

_EXCERPT: Final = 40
"""Number of bytes of a line that are shown from the difference on."""

_ABSENT: Final = object()


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
