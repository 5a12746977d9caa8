"""Input errors as data: all at once, each with its place and its cure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
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
        return "\n".join([*map(str, self.grouped), *([f"    {self.note}"] if self.note else [])])

    @property
    def grouped(self) -> list[Problem]:
        """The problems, those alike as one: see `grouped`."""
        return grouped(self.problems)


_NUMBER = re.compile(r"(?<!\w)[-+−]?\d+(?:\.\d+)?")
_FEWEST_ALIKE = 4
"""So many problems that differ in line and figures alone are said as one."""


def grouped(problems: Iterable[Problem]) -> list[Problem]:
    """The problems, those of a file that differ in their lines and figures alone as one: the first, and all lines."""
    alike: dict[tuple[str, str, str], list[Problem]] = {}
    for each in problems:
        alike.setdefault((each.file, _NUMBER.sub("#", each.what), each.cure), []).append(each)
    found = []
    for same in alike.values():
        if len(same) < _FEWEST_ALIKE or not all(each.line for each in same):
            found += same
            continue
        first = same[0]
        more = f"{first.what}; so in {len(same)} places, lines {_ranges(sorted({each.line for each in same}))}"
        found.append(replace(first, what=more))
    return sorted(found, key=lambda each: (each.file, each.line, each.column))


def _ranges(lines: Sequence[int]) -> str:
    """`2–5, 9`; lines: ascending."""
    ends = [(line, line) for line in lines[:1]]
    for line in lines[1:]:
        ends[-1:] = [(ends[-1][0], line)] if line == ends[-1][1] + 1 else [ends[-1], (line, line)]
    return ", ".join(str(first) if first == last else f"{first}–{last}" for first, last in ends)
