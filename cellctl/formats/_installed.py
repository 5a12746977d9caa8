"""Effects, compensation methods and row kinds of installed packages: they are added here, as the mathematics reads no
entry points.

Groups: `cellctl.effects`, value = a class derived from `Effect`; `cellctl.compensation_methods`, name = the method's,
value = a `Method`; `cellctl.row_kinds`, name = the kind's, value = a `RowKind`. What cannot be used is named in a
warning, and left out.
"""

from __future__ import annotations

import logging

from cellctl.calibration import Effect
from cellctl.calibration.effects import add_kind
from cellctl.compensation import METHODS, Method
from cellctl.error_maps.terms import TERMS
from cellctl.formats.measurements import KINDS, RowKind
from cellctl.installed import contributions, named_contributions


def add_installed() -> None:
    """Add the error maps, then what other packages bring, to cellctl's tables; call it once."""
    for term in TERMS:
        add_kind(term)
    broken: list[str] = []
    for label, kind in contributions("cellctl.effects", type, "effect", broken):
        try:
            if not issubclass(kind, Effect):
                raise ValueError("it is not derived from Effect")
            add_kind(kind)
        except ValueError as error:
            broken.append(f"{label} is not used: {error}")
    for name, label, method in named_contributions("cellctl.compensation_methods", Method, "method", broken):
        if METHODS.setdefault(name, method) is not method:
            broken.append(f"{label} is not used: there is a method '{name}' already")
    for name, label, row_kind in named_contributions("cellctl.row_kinds", RowKind, "row kind", broken):
        if KINDS.setdefault(name, row_kind) is not row_kind:
            broken.append(f"{label} is not used: there is a row kind '{name}' already")
    for text in broken:
        logging.getLogger(__name__).warning(text)
