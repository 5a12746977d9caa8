"""Mistakes made in setting up: found, named with evidence and cure, never repaired."""

from cellctl.setup_check.find import Mistake, SetUp, find_mistakes
from cellctl.setup_check.plausibility import WideFit
from cellctl.setup_check.spacings import DeniedScale, DeniedSpacing, denied_spacings
from cellctl.setup_check.supposition import Change, Source

__all__ = [
    "Change",
    "DeniedScale",
    "DeniedSpacing",
    "Mistake",
    "SetUp",
    "Source",
    "WideFit",
    "denied_spacings",
    "find_mistakes",
]
