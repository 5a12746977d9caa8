"""Abilities of this system: cells run on Linux only, file operations on any system."""

from __future__ import annotations

from cellctl.files import InputError, Problem
from cellctl.files.locked import HAS_LOCKS


def require_cells() -> None:
    """Raise InputError on systems other than Linux: drivers and simulators need Linux."""
    if not HAS_LOCKS:
        cure = "do it on Linux; fit, predict, compensate, convert, import, report, runs and show work here"
        raise InputError(Problem("this system", 0, 0, "cannot work with a cell: it has no POSIX terminals", cure))
