"""The controller's variables by name, of its system and of CELLCTL_KVP's data list; types of KRL and values as text."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, final

from sims.scene.motions import Joints

LARGEST = 2**31 - 1

_PART = re.compile(r'(\w+)(\[\])?\s+("[^"]*"|[^,"]+)')


class BadValue(ValueError):
    """A text that is no value of the type."""


class Kind(Protocol):
    """A type: a variable's first value, its text, and what a text makes of the value before it."""

    def first(self) -> Any:
        """The value before anything was written."""

    def shown(self, value: Any) -> str:
        """The value as the controller prints it."""

    def read(self, text: str, before: Any) -> Any:
        """The value that `text` says. Raises BadValue."""


@final
class Int:
    """A whole number of 32 bits."""

    def first(self) -> int:
        """Zero."""
        return 0

    def shown(self, value: int) -> str:
        """Decimal."""
        return str(value)

    def read(self, text: str, before: int) -> int:
        """A real number is rounded, as an assignment in KRL does."""
        if not re.fullmatch(r"\s*[-+]?\d+(\.\d*)?\s*", text, re.ASCII):
            raise BadValue(text)
        value = round(float(text)) if "." in text else int(text)
        if not -LARGEST - 1 <= value <= LARGEST:
            raise BadValue(text)
        return value


@final
class Bool:
    """TRUE or FALSE."""

    def first(self) -> bool:
        """FALSE."""
        return False

    def shown(self, value: bool) -> str:
        """In capital letters."""
        return "TRUE" if value else "FALSE"

    def read(self, text: str, before: bool) -> bool:
        """In any letters."""
        word = text.strip().upper()
        if word not in ("TRUE", "FALSE"):
            raise BadValue(text)
        return word == "TRUE"


@final
@dataclass(frozen=True)
class Chars:
    """A CHAR array of `size`."""

    size: int

    def first(self) -> str:
        """A blank, as the data list has it."""
        return " "

    def shown(self, value: str) -> str:
        """In quotation marks."""
        return f'"{value}"'

    def read(self, text: str, before: str) -> str:
        """With or without quotation marks; what is too long is refused."""
        value = text.strip().strip('"')
        if len(value) > self.size:
            raise BadValue(text)
        return value


@final
@dataclass(frozen=True)
class Structure:
    """A STRUC: its name and its fields. A field that a text leaves out stays as it was."""

    name: str
    fields: Mapping[str, Kind]

    def first(self) -> dict[str, Any]:
        """Each field's first value."""
        return {name: kind.first() for name, kind in self.fields.items()}

    def shown(self, value: Mapping[str, Any]) -> str:
        """`{NAME: A 1, B[] "x"}`."""
        parts = []
        for name, kind in self.fields.items():
            mark = "[]" if isinstance(kind, Chars) else ""
            parts.append(f"{name}{mark} {kind.shown(value[name])}")
        return "{" + f"{self.name}: " + ", ".join(parts) + "}"

    def read(self, text: str, before: Mapping[str, Any]) -> dict[str, Any]:
        """Any order, with or without the name before the colon."""
        found = re.fullmatch(r"\s*\{\s*(?:(\w+)\s*:)?\s*(.*?)\s*\}\s*", text, re.DOTALL)
        if not found or (found[1] and found[1].upper() != self.name):
            raise BadValue(text)
        value, rest = dict(before), found[2]
        while rest:
            part = _PART.match(rest)
            kind = self.fields.get(part[1].upper()) if part else None
            if part is None or kind is None or bool(part[2]) != isinstance(kind, Chars):
                raise BadValue(text)
            value[part[1].upper()] = kind.read(part[3], value[part[1].upper()])
            rest = rest[part.end() :].lstrip(" ,")
        return value


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


VERSION = 1
BANKS, ROWS, AXES = 3, 500, 6

_ANGLES = tuple(f"A{axis}" for axis in range(1, AXES + 1))
_WEIGHED = ("NUMBER", "ROW", "PERCENT", *_ANGLES)

JOB = Structure("KV_JOB_T", {name: Int() for name in (*_WEIGHED, "CHECK")})
BANK = Structure("KV_BANK_T", {"ID": Chars(64), "SUM": Chars(8), "ROWS": Int(), "TAKEN": Int()})
ROW = Structure("KV_ROW_T", {f"{letter}{axis}": Int() for letter in "NC" for axis in range(1, AXES + 1)})


@final
class DataList:
    """Its variables, by capital letters in `variables`."""

    def __init__(self) -> None:
        self.version = Data(Int(), values={(): VERSION})
        self.allow_t1 = Data(Bool())
        self.go, self.done, self.outcome = (Data(Int()) for _ in range(3))
        self.job = Data(JOB)
        self.bank = Data(BANK, (BANKS,))
        self.table = Data(ROW, (BANKS, ROWS))
        self.roles = Data(Int())
        self.variables: dict[str, Variable] = {
            "KV_VERSION": self.version,
            "KV_ALLOW_T1": self.allow_t1,
            "KV_GO": self.go,
            "KV_DONE": self.done,
            "KV_OUTCOME": self.outcome,
            "KV_JOB": self.job,
            "KV_BANK": self.bank,
            "KV_TAB": self.table,
            "KV_ROLES": self.roles,
        }

    def job_fits(self, number: int) -> bool:
        """Whether the job is the one of this number, and its check is right."""
        job = self.job.get()
        total = sum(weight * job[name] for weight, name in enumerate(_WEIGHED, 1))
        return bool(job["NUMBER"] == number and job["CHECK"] == total)

    def target(self) -> Joints | None:
        """Where the job goes, degrees; None where the active table has no such row."""
        job = self.job.get()
        if not job["ROW"]:
            return tuple(job[name] / 10_000 for name in _ANGLES)
        place = self.roles.get() // 100
        if not 1 <= place <= BANKS or not 1 <= job["ROW"] <= min(ROWS, self.bank.get(place)["TAKEN"]):
            return None
        row = self.table.get(place, job["ROW"])
        return tuple(row[f"C{axis}"] / 1_000_000 for axis in range(1, AXES + 1))

    def state(self) -> dict[str, Any]:
        """The tables, as JSON has them."""
        return {
            "roles": self.roles.get(),
            "banks": {str(place): self.bank.get(place) for place in range(1, BANKS + 1)},
            "rows": [[*index, *row.values()] for index, row in self.table.values.items()],
        }

    def recall(self, state: Mapping[str, Any]) -> None:
        """The tables of a `state` that was kept. Raises ValueError, TypeError, LookupError, AttributeError."""
        self.roles.values[()] = int(state["roles"])
        for place, bank in state["banks"].items():
            self.bank.values[(int(place),)] = {
                "ID": str(bank["ID"]),
                "SUM": str(bank["SUM"]),
                "ROWS": int(bank["ROWS"]),
                "TAKEN": int(bank["TAKEN"]),
            }
        for place, number, *angles in state["rows"]:
            self.table.values[(int(place), int(number))] = dict(zip(ROW.fields, map(int, angles), strict=True))
