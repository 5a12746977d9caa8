"""Progress reports of a long computation, independent of the receiver."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float], None]
"""Takes the current activity, in a few words, and the share (0 … 1) of all work that is done."""


def silent(doing: str, share: float) -> None:
    """Ignores the report."""


def part_of(progress: Progress, begin: float, end: float, name: str = "") -> Progress:
    """A progress of its own for the work between the shares `begin` and `end` of the whole: `name: doing`."""

    def reported(doing: str, share: float) -> None:
        words = ": ".join(word for word in (name, doing) if word)
        progress(words, begin + share * (end - begin))

    return reported
