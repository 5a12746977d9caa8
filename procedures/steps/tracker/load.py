"""The load that a campaign records; a controller that corrects its own geometry is refused."""

from __future__ import annotations

from cellctl.files import Document, InputError
from cellctl.formats.load import Load, load_of

_NONE = Load(name="none", mass=0.0, xyz=[0.0, 0.0, 0.0])


def recorded_load(document: Document) -> Load:
    """The `load:` of a loaded cell file; without one, nothing is carried. Raises InputError.

    A controller with absolute accuracy is refused: table and option would correct the same error twice.
    """
    load = load_of(document) or _NONE
    if load.absolute_accuracy:
        what = "the controller's absolute accuracy is on: it and a compensation table correct the same errors twice"
        cure = "switch the option off on the controller and write `absolute_accuracy: false`"
        raise InputError(document.problem(("load", "absolute_accuracy"), what, cure))
    return load
