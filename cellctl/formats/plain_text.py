"""Text as saved by pendants and spreadsheets, in any of their encodings."""

from __future__ import annotations

from cellctl.files import InputError, Problem

_SPREADSHEETS = {
    b"PK\x03\x04": "a spreadsheet (xlsx, ods) or another archive",
    b"\xd0\xcf\x11\xe0": "a spreadsheet (xls)",
}


def decoded(data: bytes, file: str) -> str:
    """A file's text: UTF-8 or UTF-16 (marked), else Windows' Western code page.

    `file` names it in errors. Raises InputError for a spreadsheet.
    """
    for start, what in _SPREADSHEETS.items():
        if data.startswith(start):
            raise InputError(Problem(file, 0, 0, f"is {what}, not text", "save the sheet as CSV"))
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace")
    for encoding in ("utf-8-sig", "cp1252"):
        try:
            return data.decode(encoding)
        except UnicodeDecodeError:
            continue
    return data.decode("latin-1")
