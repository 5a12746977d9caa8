"""An error that nobody expected in one run is logged and shown there; it must not stop the others."""

from __future__ import annotations

import logging
from pathlib import Path

from cellctl.files import Problem


def unexpected(run_folder: Path, error: Exception) -> Problem:
    """The problem to show for `error`; its traceback goes to the log."""
    logging.getLogger(__name__).error("%s cannot be shown", run_folder, exc_info=error)
    what = f"it cannot be shown: {type(error).__name__}: {error}"
    return Problem(str(run_folder), 0, 0, what, "look at it with `cellctl show --events`, and report the error")
