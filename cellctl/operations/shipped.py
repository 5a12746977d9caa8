"""Shipped procedures, cells and robots by their names: `sphere_selfcal` in place of a path."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from cellctl.files import InputError, Problem
from cellctl.robots import near, shipped

Kind = Literal["procedure", "cell", "robot"]

_FOLDERS: dict[Kind, tuple[str, ...]] = {
    "procedure": (".", "papers"),
    "cell": ("cells", "papers/cells"),
    "robot": ("robots",),
}


def shipped_file(kind: Kind, given: Path) -> Path:
    """`given` itself if it is a path, else the shipped file of that name.

    An existing file has priority; a text with a folder or a suffix is a path. The result is relative if the shipped
    files are below the working folder. Raises InputError for a name that is neither a file nor shipped.
    """
    if given.is_file() or given.suffix or len(given.parts) != 1:
        return given
    names = shipped_names(kind)
    if given.name not in names:
        what = f"is no file, and no shipped {kind} has this name"
        cure = near(given.name) if kind == "robot" else f"one of: {', '.join(names)}"
        raise InputError(Problem(str(given), 0, 0, what, f"give a path, or {cure}"))
    file, here = names[given.name], Path.cwd()
    return file.relative_to(here) if file.is_relative_to(here) else file


def shipped_names(kind: Kind) -> dict[str, Path]:
    """Name → file of all shipped files of that kind, sorted by name in each folder."""
    return {name: file for folder in _FOLDERS[kind] for name, file in shipped(folder).items()}
