"""Effects and compensation methods of installed packages: the mathematics reads no entry points, they are added here.

Groups: `cellctl.effects`, value = a class derived from `Effect`; `cellctl.compensation_methods`, name = the method's,
value = a `Method`. What cannot be used is named in a warning, and left out.
"""

from __future__ import annotations

import logging

from cellctl.calibration import Effect
from cellctl.calibration.effects import add_kind
from cellctl.compensation import METHODS, Method
from cellctl.error_maps.terms import TERMS
from cellctl.installed import contributions, named_contributions


def add_installed() -> None:
    """Add the error maps, then those of other packages, to cellctl's effects; call it once."""
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
    for text in broken:
        logging.getLogger(__name__).warning(text)
