"""Mistakes made in setting up: found, named with evidence and cure, never repaired."""

from cellctl.calibration.mistakes.find import Mistake, SetUp, find_mistakes
from cellctl.calibration.mistakes.supposition import Change, Source

__all__ = ["Change", "Mistake", "SetUp", "Source", "find_mistakes"]
