"""Typed looks into a YAML mapping, which collect every error instead of stopping at the first."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, final

_REQUIRED: Any = object()
_WORDS = {3: "three"}


@final
class Section:
    """A mapping at a place (`simulate.rsi`) of a file. An error is noted in `problems`; something harmless given."""

    def __init__(self, value: object, where: str, problems: list[str]) -> None:
        self.where = where
        self.problems = problems
        self.entries: dict[str, Any] = {}
        if isinstance(value, dict):
            self.entries = {str(key): entry for key, entry in value.items()}
        elif value is not None:
            problems.append(f"{where or 'the file'}: settings are expected here, not {value!r}")

    def place(self, key: str) -> str:
        """Where `key` is, as a person says it."""
        return f"{self.where}.{key}" if self.where else key

    def note(self, key: str, what: str) -> None:
        """An error at `key`."""
        self.problems.append(f"{self.place(key)}: {what}")

    def only(self, known: Iterable[str]) -> None:
        """Note each key that is not known."""
        names = sorted(known)
        for key in self.entries.keys() - set(names):
            self.note(key, f"unknown; here can be {', '.join(names)}")

    def number(self, key: str, default: float = _REQUIRED, least: float = -math.inf) -> float:
        """A finite number, at least `least`."""
        value = self._get(key, default)
        if value is None:
            return 0.0
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            self.note(key, f"a number is expected, not {value!r}")
            return 0.0
        if value < least:
            self.note(key, f"at least {least:g} is expected, not {value!r}")
        return float(value)

    def whole(self, key: str, default: int = _REQUIRED, least: int = 0) -> int:
        """A whole number, at least `least`."""
        value = self._get(key, default)
        if value is None:
            return least
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            self.note(key, f"a whole number of at least {least} is expected, not {value!r}")
            return least
        return value

    def scale(self, key: str, default: float) -> float:
        """`false` (0), `true` (1), or a number that is not negative."""
        value = self.entries.get(key, default)
        return float(value) if isinstance(value, bool) else self.number(key, default, 0.0)

    def word(self, key: str, default: str = _REQUIRED, among: Iterable[str] = ()) -> str:
        """A text; one of `among` where that is given."""
        value = self._get(key, default)
        if value is None:
            return ""
        choices = list(among)
        if not isinstance(value, str) or (choices and value not in choices):
            expected = " or ".join(choices) if choices else "a text"
            self.note(key, f"{expected} is expected, not {value!r}")
            return ""
        return value

    def triple(self, key: str, default: tuple[float, float, float] = _REQUIRED) -> tuple[float, float, float]:
        """Three numbers."""
        x, y, z = self.numbers(key, 3, default)
        return (x, y, z)

    def numbers(self, key: str, count: int, default: tuple[float, ...] = _REQUIRED) -> tuple[float, ...]:
        """So many numbers."""
        value = self._get(key, default)
        if value is None:
            return (0.0,) * count
        if not isinstance(value, (list, tuple)) or len(value) != count:
            self.note(key, f"{_WORDS.get(count, count)} numbers are expected, not {value!r}")
            return (0.0,) * count
        parts = Section({str(i): part for i, part in enumerate(value)}, self.place(key), self.problems)
        return tuple(parts.number(str(i)) for i in range(count))

    def below(self, key: str, *, required: bool = False) -> Section:
        """The mapping at `key`; an empty one where there is none."""
        return Section(self._get(key, _REQUIRED if required else None), self.place(key), self.problems)

    def each(self, key: str, *, required: bool = False) -> list[Section]:
        """The mappings in the list at `key`."""
        value = self._get(key, _REQUIRED if required else None)
        if value is not None and not isinstance(value, list):
            self.note(key, f"a list is expected, not {value!r}")
        entries = value if isinstance(value, list) else []
        return [Section(entry, f"{self.place(key)}[{i}]", self.problems) for i, entry in enumerate(entries)]

    def _get(self, key: str, default: Any) -> Any:
        value = self.entries.get(key)
        if value is not None:
            return value
        if default is _REQUIRED:
            self.note(key, "is missing")
            return None
        return default
