"""Places of named points in an array, so that a change is sent as the few places that it changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

Value = tuple[float, ...]


@final
@dataclass(frozen=True)
class Change:
    """The array has `length` places from now on; those at `places` have new `values`, one after the other."""

    length: int
    places: Sequence[int]
    values: Sequence[float]


@final
class Slots:
    """Gives each point a place and keeps it there; a removed one is replaced by the last."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._values: list[Value] = []
        self._place: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._names)

    @property
    def values(self) -> list[float]:
        """All values, one after the other."""
        return [number for value in self._values for number in value]

    def update(self, wanted: Mapping[str, Value]) -> Change | None:
        """Hold exactly the points `wanted`; None if that changes nothing."""
        before = len(self)
        changed = {place for name in [n for n in self._names if n not in wanted] for place in self._removed(name)}
        for name, value in wanted.items():
            place = self._place.get(name)
            if place is None:
                changed.add(self._added(name, value))
            elif self._values[place] != value:
                self._values[place] = value
                changed.add(place)
        places = sorted(place for place in changed if place < len(self))
        if not places and len(self) == before:
            return None
        return Change(len(self), places, [number for place in places for number in self._values[place]])

    def _added(self, name: str, value: Value) -> int:
        self._place[name] = len(self._names)
        self._names.append(name)
        self._values.append(value)
        return self._place[name]

    def _removed(self, name: str) -> list[int]:
        place, last, value = self._place.pop(name), self._names.pop(), self._values.pop()
        if last == name:
            return []
        self._names[place], self._values[place], self._place[last] = last, value, place
        return [place]
