"""Defaults for journals written before rows described themselves: all of them are of touched spheres."""

from __future__ import annotations

from typing import Final

MEASURED_KINDS: Final = frozenset({"touch"})
"""Row kinds that are measured points."""

SECTION: Final = ("held_out", "standoff", "drift", "stops")
"""The verdict's fields in the result besides the common ones."""
