"""Expressions of `if:`: a reference, `not` a reference, or a reference compared with a literal."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Self, final

from cellctl.procedure.fields import is_number
from cellctl.procedure.references import Reference, resolve

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
