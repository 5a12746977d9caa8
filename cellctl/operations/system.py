"""What this system can do: cells are run on Linux, files are worked on anywhere."""

from __future__ import annotations

from cellctl.files import InputError, Problem
from cellctl.journal.lock import HAS_LOCKS


def require_cells() -> None:
    """Raise InputError where no cell can be run, checked or simulated: drivers and simulators need Linux."""
    if not HAS_LOCKS:
        cure = "do it on Linux; fit, predict, compensate, convert, import, report, runs and show work here"
        raise InputError(Problem("this system", 0, 0, "cannot work with a cell: it has no POSIX terminals", cure))
