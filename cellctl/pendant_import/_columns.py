"""The columns of a table as a person chooses among them: heading, first values, and what the heading means."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.files import InputError
from cellctl.pendant_import._points import lines_of, read_text
from cellctl.pendant_import._typed_table import cells_of, heading

_SAMPLES = 3
_LINES = 200
"""Of a table, the first lines: they have the headings, and enough rows to find the separator."""

_FEWEST_JOINTS = 4
_OF_A_JOINT = re.compile(r"joint|axis|achse|gelenk|\bj\d", re.IGNORECASE)
_OF_A_MEASUREMENT = ("temperature", "payload", "session", "set")


@final
@dataclass(frozen=True, slots=True)
class FileColumn:
    """A column of a table. means: its column in a data set (`A1`, `X`, `name`), empty where the heading says none.

    guess: what it can be by its place and words, for a person to confirm.
    """

    heading: str
    samples: tuple[str, ...]
    means: str = ""
    guess: str = ""


def columns_of(path: Path) -> tuple[FileColumn, ...]:
    """The columns of a table with headings; none for a robot program, or a file that is no such table."""
    try:
        table = cells_of("\n".join(lines_of(read_text(path))[:_LINES]), str(path))
    except InputError:
        return ()
    for place, row in enumerate(table.rows):
        if not row.numbers and len(row.cells) > 2:
            below = [each.cells for each in table.rows[place + 1 :] if each.numbers][:_SAMPLES]
            return _guessed(row.cells, below)
        if row.numbers:
            break
    return ()


def _guessed(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> tuple[FileColumn, ...]:
    means = [heading(text).column for text in headings]
    joints = [place for place, text in enumerate(headings) if not means[place] and _OF_A_JOINT.search(text)]
    guesses = {place: f"A{number}" for number, place in enumerate(joints, 1)} if len(joints) >= _FEWEST_JOINTS else {}
    for name in _OF_A_MEASUREMENT:
        fitting = [place for place, text in enumerate(headings) if name in re.split(r"[\W_]+", text.casefold())]
        guesses |= {fitting[0]: name} if len(fitting) == 1 and not means[fitting[0]] else {}
    return tuple(
        FileColumn(text, tuple(row[place] for row in rows if place < len(row)), means[place], guesses.get(place, ""))
        for place, text in enumerate(headings)
        if text
    )
