"""Set-up errors: found, reported with evidence and cure, never repaired."""

from cellctl.setup_check._check import SetupCheck, SetupError, check_setup
from cellctl.setup_check._spacing_errors import ScaleError, SpacingError, find_spacing_errors
from cellctl.setup_check._wide_fit import OFF_MM, WideFit, WrongLength
from cellctl.setup_check.hypothesis import Change, Source

__all__ = [
    "OFF_MM",
    "Change",
    "ScaleError",
    "SetupCheck",
    "SetupError",
    "Source",
    "SpacingError",
    "WideFit",
    "WrongLength",
    "check_setup",
    "find_spacing_errors",
]
