"""A typed table as rows of cells: the separator of the columns, and the rows with numbers."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from typing import final

from cellctl.files import InputError, Problem
from cellctl.formats.spreadsheet_text import is_number
from cellctl.pendant_import.text import lines_of

_SEPARATORS = {"\t": "tabs", ";": "semicolons", ",": "commas", " ": "spaces"}
_SEP_LINE = re.compile(r'\ufeff?"?sep=(.)"?\s*', re.IGNORECASE)
_COMMENT = re.compile(r"^\s*//.*$|\s(?:#|//)\s.*$")
_NUMBERS_IN_A_ROW = 3
_ENOUGH = 500
"""Lines that are tried with each separator."""


@final
@dataclass(frozen=True, slots=True)
class Row:
    """One row: its line, its cells (empty ones at the end are left out), and how many of them are numbers."""

    line: int
    cells: tuple[str, ...]
    numbers: int
    remark: str = ""


@final
@dataclass(frozen=True, slots=True)
class Cells:
    """A table as cells. separated: the separator, in words. notes: lines that begin with `//`, with their number."""

    file: str
    rows: tuple[Row, ...]
    separated: str
    notes: tuple[tuple[int, str], ...] = ()


def cells_of(text: str, file: str) -> Cells:
    """The rows that are not empty. Raises InputError where no separator gives rows with three numbers."""
    lines = [(number, line) for number, line in enumerate(lines_of(text), 1) if line.strip()]
    stated = _SEP_LINE.fullmatch(lines[0][1]) if lines else None
    tried = [stated[1]] if stated else list(_SEPARATORS)
    lines = lines[bool(stated) :]
    good = {mark: sum(row.numbers >= _NUMBERS_IN_A_ROW for row in _rows(lines[:_ENOUGH], mark)) for mark in tried}
    mark = max(tried, key=lambda each: good[each])
    if not good[mark]:
        what = "holds no row with three numbers, whatever separates the columns: tabs, semicolons, commas or spaces"
        cure = "separate the columns by semicolons or tabs; commas cannot be decimal sign and separator at once"
        raise InputError(Problem(file, 0, 0, what, cure))
    notes = tuple((number, line.strip(" \t/")) for number, line in lines if line.lstrip().startswith("//"))
    return Cells(file, tuple(_rows(lines, mark)), _SEPARATORS.get(mark, f"'{mark}'"), notes)


def _rows(lines: list[tuple[int, str]], mark: str) -> list[Row]:
    rows = [_row(number, line, mark) for number, line in lines]
    return [row for row in rows if any(row.cells)]


def _split(text: str, mark: str) -> list[str]:
    if mark == " ":
        return text.split()
    try:
        return next(csv.reader([text], delimiter=mark), [])
    except csv.Error:  # a cell is longer than CSV allows
        return text.split(mark)


def _row(number: int, line: str, mark: str) -> Row:
    comment = _COMMENT.search(line) if not line.lstrip().startswith("#") else None
    text = line[: comment.start()] if comment else line
    cells = [cell.strip() for cell in _split(text, mark)]
    while cells and not cells[-1]:
        cells.pop()
    numbers = sum(is_number(cell, spaced=mark not in ", ") for cell in cells)
    return Row(number, tuple(cells), numbers, comment[0].strip(" \t#/") if comment else "")
