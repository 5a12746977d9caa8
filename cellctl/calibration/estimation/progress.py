"""How a long computation says how far it is, without knowing who listens."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[str, float], None]
"""Takes what is being done from now on, in a few words, and the share (0 … 1) of all work that lies behind it."""


def silent(doing: str, share: float) -> None:
    """For those whom nobody watches."""


def part_of(progress: Progress, begin: float, end: float, name: str = "") -> Progress:
    """A progress of its own for the work between the shares `begin` and `end` of the whole: `name: doing`."""

    def reported(doing: str, share: float) -> None:
        words = ": ".join(word for word in (name, doing) if word)
        progress(words, begin + share * (end - begin))

    return reported
