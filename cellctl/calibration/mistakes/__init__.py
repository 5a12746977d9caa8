"""Mistakes made in setting up: found, named with evidence and cure, never repaired."""

from cellctl.calibration.mistakes.find import Mistake, SetUp, find_mistakes
from cellctl.calibration.mistakes.plausibility import WideFit
from cellctl.calibration.mistakes.spacings import DeniedScale, DeniedSpacing, denied_spacings
from cellctl.calibration.mistakes.supposition import Change, Source

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
