"""Suggests known words for an unknown one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """A cure for an unknown `word`: the nearest known one, or else the short list of them, or `otherwise`."""
    names = sorted(known)
    near = difflib.get_close_matches(word, names, n=1)
    if near:
        return f"did you mean '{near[0]}'?"
    if otherwise or not names:
        return otherwise
    return f"known here: {', '.join(names)}"
