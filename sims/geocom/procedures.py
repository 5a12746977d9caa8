"""The remote procedures: number → types of the parameters and what it does. Unknown numbers and types are refused."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

from sims.geocom.codes import Code
from sims.geocom.lines import Value, read_double, read_string, read_whole
from sims.geocom.work import DONE, Answer, Step

READERS: dict[str, Callable[[str], Value]] = {"i": read_whole, "d": read_double, "s": read_string}
"""By letter: whole number, double, string."""

BOOLEANS = (0, 1)


class BadParameter(ValueError):
    """A parameter's value that the procedure does not take."""


@final
@dataclass(frozen=True, slots=True)
class Procedure:
    """One RPC. types: a letter of `READERS` for each parameter, as "ddi"."""

    types: str
    action: Callable[..., Step]

    def call(self, parameters: Sequence[str]) -> Step:
        """Do it. Code IVPARAM where number, type or value of the parameters is wrong."""
        if len(parameters) != len(self.types):
            return Answer(Code.IVPARAM)
        try:
            return self.action(*(READERS[kind](text) for kind, text in zip(self.types, parameters, strict=True)))
        except ValueError:
            return Answer(Code.IVPARAM)


Procedures = Mapping[int, Procedure]


def setter(types: str, action: Callable[..., object]) -> Procedure:
    """A procedure that sets something at once and answers with its code alone."""

    def do(*values: Any) -> Step:
        action(*values)
        return DONE

    return Procedure(types, do)


def getter(values: Callable[[], Iterable[Value]]) -> Procedure:
    """A procedure without parameters that answers at once."""
    return Procedure("", lambda: Answer(values=tuple(values())))


def among(value: int, possible: Iterable[int]) -> int:
    """The value. Raises BadParameter where it is not one of those."""
    if value not in possible:
        raise BadParameter(value)
    return value


def positive(value: float) -> float:
    """The value. Raises BadParameter where it is not above 0."""
    if value <= 0.0:
        raise BadParameter(value)
    return value
