"""The controller's variables by name: of its system, and of the data list that is loaded."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol, final

from sims.varproxy.values import BadValue, Chars, Kind, Structure

_NAME = re.compile(r"(\$?\w+)(?:\[([\d,\s]*)\])?(?:\.(\w+)(\[\])?)?", re.ASCII)

Index = tuple[int, ...]


class Refused(Exception):
    """No such variable, no such element, a value of another type, or a variable that cannot be written."""


class Variable(Protocol):
    """A variable or an array; `part` names a field of a structure, in capital letters, or is empty."""

    def read(self, index: Index, part: str) -> str:
        """Its value as text. Raises Refused."""

    def write(self, index: Index, part: str, text: str) -> None:
        """Give it a value. Raises Refused."""


@final
@dataclass
class Data:
    """A variable of a data list: of one kind, an array where it has `sizes`. `changed(index)` follows each write."""

    kind: Kind
    sizes: Index = ()
    changed: Callable[[Index], object] = lambda index: None
    values: dict[Index, Any] = field(default_factory=dict)

    def get(self, *index: int) -> Any:
        """The value of an element."""
        return self.values.get(index, self.kind.first())

    def read(self, index: Index, part: str) -> str:
        """A whole element, or one field of it."""
        self._check(index)
        kind = self._part(part)
        value = self.get(*index)
        return kind.shown(value[part] if part else value)

    def write(self, index: Index, part: str, text: str) -> None:
        """A whole element, or one field of it."""
        self._check(index)
        kind, value = self._part(part), self.get(*index)
        try:
            self.values[index] = {**value, part: kind.read(text, value[part])} if part else kind.read(text, value)
        except BadValue as error:
            raise Refused(f"'{error}' is no value of its type") from None
        self.changed(index)

    def _check(self, index: Index) -> None:
        within = all(1 <= i <= size for i, size in zip(index, self.sizes, strict=False))
        if len(index) != len(self.sizes) or not within:
            raise Refused("there is no such element")

    def _part(self, part: str) -> Kind:
        if not part:
            return self.kind
        if not isinstance(self.kind, Structure) or part not in self.kind.fields:
            raise Refused(f"there is no field {part}")
        return self.kind.fields[part]


@final
@dataclass(frozen=True)
class System:
    """A variable of the system: what it shows, and what a write does; None: it cannot be written."""

    shown: Callable[[Index], str]
    set: Callable[[Index, str], None] | None = None
    size: int = 0

    def read(self, index: Index, part: str) -> str:
        """As the controller shows it now."""
        self._check(index, part)
        return self.shown(index)

    def write(self, index: Index, part: str, text: str) -> None:
        """If it can be written."""
        self._check(index, part)
        if self.set is None:
            raise Refused("it cannot be written")
        try:
            self.set(index, text)
        except BadValue as error:
            raise Refused(f"'{error}' is no value of its type") from None

    def _check(self, index: Index, part: str) -> None:
        expected = 1 if self.size else 0
        if part or len(index) != expected or (index and not 1 <= index[0] <= self.size):
            raise Refused("there is no such element")


@final
class Variables:
    """All of them. `hidden`: whether a variable of this name is unknown at present."""

    def __init__(self, variables: dict[str, Variable], hidden: Callable[[str], bool] = lambda name: False) -> None:
        self._variables = variables
        self._hidden = hidden

    def read(self, name: str) -> str:
        """The value as text. Raises Refused."""
        variable, index, part = self._find(name)
        return variable.read(index, part)

    def write(self, name: str, text: str) -> None:
        """Raises Refused."""
        variable, index, part = self._find(name)
        variable.write(index, part, text)

    def _find(self, name: str) -> tuple[Variable, Index, str]:
        found = _NAME.fullmatch(name.strip())
        variable = self._variables.get(found[1].upper()) if found else None
        if found is None or variable is None or self._hidden(found[1].upper()):
            raise Refused("there is no such variable")
        index = tuple(int(i) for i in (found[2] or "").split(",") if i.strip())
        part = (found[3] or "").upper()
        if isinstance(variable, Data) and found[4] and not isinstance(variable.kind, Chars | Structure):
            raise Refused("it is no text")
        return variable, index, part
