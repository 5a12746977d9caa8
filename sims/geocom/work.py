"""What an RPC comes to: an answer at once, or work that takes time and goes on from there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from sims.geocom.codes import CARRY_DATA, Code
from sims.geocom.lines import Value


@final
@dataclass(frozen=True, slots=True)
class Answer:
    """RC and the parameters. A code that carries no data has none."""

    code: Code = Code.OK
    values: tuple[Value, ...] = ()

    def __post_init__(self) -> None:
        if self.code not in CARRY_DATA:
            object.__setattr__(self, "values", ())


@final
@dataclass(frozen=True, slots=True)
class Work:
    """Busy for `duration_ns`; `then` gives what comes next."""

    duration_ns: int
    then: Callable[[], Step]


Step = Answer | Work
DONE = Answer()


def seconds(value: float) -> int:
    """As nanoseconds."""
    return round(value * 1e9)
