"""A file of a pendant or a spreadsheet as text, from any of its encodings."""

from __future__ import annotations

import re
from pathlib import Path

from cellctl.files import InputError, Problem
from cellctl.files.kinds import EXPORT, OWN, kind_of, refuse_other_kind
from cellctl.formats.spreadsheet_text import decoded


def read_text(path: Path) -> str:
    """The file's text: UTF-8 or UTF-16 (marked), else Windows' Western code page. Raises InputError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(Problem(str(path), 0, 0, f"cannot be read: {error.strerror}", "check the path")) from error
    text = decoded(data, str(path))
    if (found := kind_of(text)) in OWN:
        refuse_other_kind(path, EXPORT, found)
    if "\0" in text:
        raise InputError(Problem(str(path), 0, 0, "is not text", "give a KRL, script or CSV file"))
    if not text.strip():
        raise InputError(Problem(str(path), 0, 0, "is empty"))
    return text


def lines_of(text: str) -> list[str]:
    """The lines, with any line ends; unlike in `str.splitlines`, only CR and LF end a line."""
    return re.split(r"\r\n|\n|\r", text)


def unified(text: str) -> str:
    """The text with LF at the end of each line."""
    return text.replace("\r\n", "\n").replace("\r", "\n")
