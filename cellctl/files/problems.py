"""Input errors as data: all at once, each with its place and its cure."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import final


@final
@dataclass(frozen=True, slots=True)
class Problem:
    """One error: its place, what is wrong, and what to do.

    `line` and `column` count from 1; 0: the error concerns the whole file (or the whole line).
    """

    file: str
    line: int
    column: int
    what: str
    cure: str = ""

    def __str__(self) -> str:
        place = self.file
        if self.line:
            place += f":{self.line}"
            if self.column:
                place += f":{self.column}"
        cure = f"\n    {self.cure}" if self.cure else ""
        return f"{place}: {self.what}{cure}"


@final
class InputError(Exception):
    """The user's input is invalid; nothing was written. The command line ends with exit code 2.

    note: one remark for all problems together.
    """

    def __init__(self, problems: Iterable[Problem] | Problem, note: str = "") -> None:
        found = [problems] if isinstance(problems, Problem) else list(problems)
        self.problems = sorted(found, key=lambda p: (p.file, p.line, p.column))
        self.note = note
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join([*map(str, self.problems), *([f"    {self.note}"] if self.note else [])])
