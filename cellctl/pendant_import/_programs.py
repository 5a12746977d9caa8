"""The languages of robot programs: which one a text is, and its points as postures or as targets."""

from __future__ import annotations

from cellctl.pendant_import import _fanuc, _krl, _rapid, _script
from cellctl.pendant_import._language import Language, Targets
from cellctl.pendant_import._points import RawList

LANGUAGES: tuple[Language, ...] = (_fanuc.FANUC, _rapid.RAPID, _krl.KRL, _krl.AXIS_LISTING, _script.NUMBER_LISTS)
"""In the order in which a text is looked at; the first that recognises it reads it."""


def program_postures(text: str, file: str, joints: int | None) -> RawList | None:
    """The postures of a program or of a listing of axes; None for a table. joints: how many the robot has."""
    read = (language.postures(text, file, joints) for language in LANGUAGES)
    return next((found for found in read if found is not None), None)


def program_targets(text: str, file: str) -> Targets | None:
    """The Cartesian points of a program; None for a table."""
    read = (language.targets(text, file) for language in LANGUAGES)
    return next((found for found in read if found is not None), None)
