"""What journals do not say that were written before rows described themselves: all of them are of touched spheres."""

from __future__ import annotations

from typing import Final

MEASURED_KINDS: Final = frozenset({"touch"})
"""Kinds of rows that were measured points."""

SECTION: Final = ("held_out", "standoff", "drift", "stops")
"""The fields of the verdict that the result showed besides the common ones."""
