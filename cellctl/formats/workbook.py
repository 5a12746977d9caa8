"""A sheet of an Excel workbook (`.xlsx`) as the text of a table: cells between tabs, decimal points."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from datetime import date, datetime, time
from io import BytesIO
from itertools import islice
from typing import Any

from openpyxl import load_workbook

from cellctl.files import InputError, Problem

START = b"PK\x03\x04"
"""How a workbook begins, and any other zip archive."""

_MOST_BYTES = 500_000_000
_MOST_ROWS, _MOST_COLUMNS = 200_000, 500
"""Of a sheet, so that a small archive with a huge content is refused before it fills the memory."""


def table_of_workbook(data: bytes, file: str) -> str:
    """The rows of the only sheet that holds any, as values: formulas as they were last computed.

    Raises InputError where `data` is no workbook, is too large, or has several sheets with rows.
    """
    cure = "save the sheet with the measurements as a workbook of its own, or as CSV"
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            if sum(part.file_size for part in archive.infolist()) > _MOST_BYTES:
                raise InputError(Problem(file, 0, 0, f"holds more than {_MOST_BYTES / 1e6:g} MB", cure))
        book = load_workbook(BytesIO(data), read_only=True, data_only=True)
        sheets = {sheet.title: _lines(sheet.iter_rows(values_only=True), file) for sheet in book.worksheets}
        book.close()
    except InputError:
        raise
    except Exception as error:  # openpyxl has no error class of its own for a damaged or foreign archive
        what = "is a spreadsheet that cannot be read, or another archive"
        raise InputError(Problem(file, 0, 0, f"{what} ({type(error).__name__})", "save the sheet as CSV")) from error
    filled = {title: lines for title, lines in sheets.items() if any(line.strip() for line in lines)}
    if len(filled) != 1:
        what = f"has rows on {len(filled)} sheets: {', '.join(filled)}" if filled else "has no sheet with rows"
        raise InputError(Problem(file, 0, 0, what, cure))
    return "\n".join(next(iter(filled.values()))) + "\n"


def _lines(rows: Iterable[tuple[Any, ...]], file: str) -> list[str]:
    found = ["\t".join(map(_text, row[:_MOST_COLUMNS])).rstrip("\t") for row in islice(rows, _MOST_ROWS + 1)]
    if len(found) > _MOST_ROWS:
        raise InputError(Problem(file, _MOST_ROWS, 0, f"has more than {_MOST_ROWS} rows", "leave rows out"))
    return found


def _text(cell: Any) -> str:
    match cell:
        case None:
            return ""
        case float():
            return repr(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
        case datetime() | date() | time():
            return cell.isoformat()
        case _:
            return " ".join(str(cell).split())
