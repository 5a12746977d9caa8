"""The method of compensation that a procedure names."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.files import InputError, Problem
from cellctl.procedure import CellContext
from cellctl.procedure.fields import did_you_mean

DEFAULT_METHOD = "pseudo-target"


def check_method(context: CellContext, known: Mapping[str, Any]) -> None:
    """Raise InputError if `method` of the known inputs is none of `cellctl.compensation`."""
    from cellctl.compensation import METHODS

    method = known.get("method", DEFAULT_METHOD)
    if method not in METHODS:
        what = f"there is no compensation method '{method}'"
        raise InputError(Problem("--set method", 0, 0, what, did_you_mean(str(method), METHODS)))
