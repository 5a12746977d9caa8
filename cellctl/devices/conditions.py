"""Conditions of a device that an interlock of a procedure can name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable


@runtime_checkable
class Conditions(Protocol):
    """A device that reports whether conditions hold: a door is closed, the drives are ready, a line is alive."""

    def conditions(self) -> Mapping[str, str]:
        """Each condition's name, with its meaning: `{"whole": "the loop is open or closed, not broken"}`.

        Known before `connect`; a name may be any text, `input(door_closed)` too.
        """

    async def holds(self, condition: str) -> bool:
        """Whether the condition holds now; called often, so it must be fast. Raises DeviceError, KeyError."""
