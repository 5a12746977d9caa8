"""References, `${name.field}`, whole values only; and the expressions of `if:`, which compare one with a literal."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Self, final

from cellctl.procedure.fields import is_number

_WHOLE = re.compile(r"\$\{([a-z][a-z0-9_]*)((?:\.[A-Za-z_][A-Za-z0-9_]*|\[[0-9]+\])*)\}")
_PART = re.compile(r"\.([A-Za-z_][A-Za-z0-9_]*)|\[([0-9]+)\]")


UNKNOWN: Final = object()
"""A value that is known only during the run."""


class UnresolvedReference(Exception):
    """A reference cannot be resolved: the name is unknown here, or its value has no such part."""


@final
@dataclass(frozen=True, slots=True)
class Reference:
    """`${name.part[3]}`: the first name, and the path after it (fields and list indices)."""

    name: str
    way: tuple[str | int, ...] = ()

    @classmethod
    def parse(cls, text: str) -> Reference:
        """Read `${…}`. Raises ValueError for anything else."""
        match = _WHOLE.fullmatch(text)
        if not match:
            raise ValueError(f"'{text}' is no reference")
        parts = _PART.finditer(match[2])
        return cls(match[1], tuple(int(part[2]) if part[1] is None else part[1] for part in parts))

    def __str__(self) -> str:
        way = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in self.way)
        return f"${{{self.name}{way}}}"


def resolve(value: Any, scope: Mapping[str, Any]) -> Any:
    """`value` with every reference replaced by its value in `scope` (name → JSON).

    Raises UnresolvedReference.
    """
    match value:
        case Reference():
            return _follow(value, scope)
        case dict():
            return {key: resolve(part, scope) for key, part in value.items()}
        case list():
            return [resolve(part, scope) for part in value]
        case _:
            return value


def references_in(value: Any, at: tuple[str | int, ...] = ()) -> Iterator[tuple[tuple[str | int, ...], Reference]]:
    """Every reference in `value`, with its place under `at`."""
    match value:
        case Reference():
            yield at, value
        case dict():
            for key, part in value.items():
                yield from references_in(part, (*at, key))
        case list():
            for index, part in enumerate(value):
                yield from references_in(part, (*at, index))


def known_part(
    value: dict[str, Any], look_up: Callable[[Reference], Any]
) -> tuple[dict[str, Any], list[tuple[str | int, ...]]]:
    """`value` with the references that `look_up` resolves replaced, the others removed; and their places.

    A list with an unknown element is left out completely, since later indices would change.
    """
    unknown: list[tuple[str | int, ...]] = []
    return _prune(value, look_up, (), unknown), unknown


def _prune(value: Any, look_up: Callable[[Reference], Any], at: tuple[str | int, ...], unknown: list[Any]) -> Any:
    match value:
        case dict():
            parts = {key: _prune(part, look_up, (*at, key), unknown) for key, part in value.items()}
            return {key: part for key, part in parts.items() if part is not UNKNOWN}
        case list():
            found: list[Any] = []
            parts_of_list = [_prune(part, look_up, at, found) for part in value]
            unknown += [at] if found else []
            return UNKNOWN if found else parts_of_list
        case Reference():
            known = look_up(value)
            unknown += [at] if known is UNKNOWN else []
            return known
        case _:
            return value


def _follow(reference: Reference, scope: Mapping[str, Any]) -> Any:
    if reference.name not in scope:
        raise UnresolvedReference(f"{reference}: '{reference.name}' is not known here")
    value = scope[reference.name]
    for part in reference.way:
        value = _part_of(value, part, reference)
    return value


def _part_of(value: Any, part: str | int, reference: Reference) -> Any:
    if isinstance(part, str) and isinstance(value, Mapping) and part in value:
        return value[part]
    if isinstance(part, int) and isinstance(value, Sequence) and not isinstance(value, str) and part < len(value):
        return value[part]
    wanted = f"element {part}" if isinstance(part, int) else f"field '{part}'"
    raise UnresolvedReference(f"{reference}: there is no {wanted} in what it names")


EXPRESSION_RULE: Final = "write ${flag}, not ${flag}, or a comparison with a literal: ${number} > 3, ${text} == 'word'"
"""The cure for a wrong expression."""

_PARTS = re.compile(
    r"(?P<negated>not\s+)?(?P<reference>\$\{[^}]*\})(?:\s*(?P<compare>==|!=|<=|>=|<|>)\s*(?P<literal>.+))?"
)
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")
_COMPARE: dict[str, Callable[[Any, Any], bool]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@final
@dataclass(frozen=True, slots=True)
class Expression:
    """`${reference}`, `not ${reference}` (`negated`), or `${reference} compare literal`."""

    reference: Reference
    negated: bool = False
    compare: str = ""
    literal: float | str | bool | None = None

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an expression. Raises ValueError with what is wrong."""
        match = _PARTS.fullmatch(text.strip())
        if not match or (match["negated"] and match["compare"]):
            raise ValueError(f"'{text}' is no expression")
        reference = Reference.parse(match["reference"])
        if not match["compare"]:
            return cls(reference, bool(match["negated"]))
        literal = _literal(match["literal"].strip())
        if match["compare"] not in ("==", "!=") and not is_number(literal):
            raise ValueError(f"'{match['compare']}' compares numbers, and {match['literal'].strip()} is none")
        return cls(reference, False, match["compare"], literal)

    @property
    def takes(self) -> str:
        """The required kind of the reference: `a flag`, `a number` or `text`."""
        return kind_of(True if not self.compare else self.literal)

    def value(self, scope: Mapping[str, Any]) -> bool:
        """Whether it is true, with `scope` (name → JSON).

        Raises UnresolvedReference; ValueError if the referenced value cannot be compared.
        """
        found = resolve(self.reference, scope)
        if kind_of(found) != self.takes:
            raise ValueError(f"{self.reference} is {kind_of(found)} (here: {found!r}), and has to be {self.takes}")
        if self.compare:
            return _COMPARE[self.compare](found, self.literal)
        return bool(found) is not self.negated


def kind_of(value: Any) -> str:
    """The kind of a value, as text: `a flag`, `a number`, `text`, or `neither flag, number nor text`."""
    if isinstance(value, bool):
        return "a flag"
    if is_number(value):
        return "a number"
    return "text" if isinstance(value, str) else "neither flag, number nor text"


def _literal(text: str) -> float | str | bool:
    if text in ("true", "false"):
        return text == "true"
    if _NUMBER.fullmatch(text):
        return float(text)
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "'\"" and text[0] not in text[1:-1]:
        return text[1:-1]
    raise ValueError(f"{text} is no literal: a number, true, false, or text in quotes")
