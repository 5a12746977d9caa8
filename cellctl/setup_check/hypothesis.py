"""What may have been mistaken: each change to a set-up with its name, its cure and the set-up as it then is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias, final

from cellctl.setup_check.setup import Setup

Source: TypeAlias = Literal["robot", "data", "artefact"]
"""The file that the mistake is in: the robot file, the data set, or what says how large the spheres are."""


@final
@dataclass(frozen=True, slots=True)
class Change:
    """One mistake and its cure.

    what: `A3 reversed`; `{0}`, `{1}` in it stand for `rows`, indices of the task's rows, where not all are concerned.
    source, key: the file, and where in it: a path of keys (`("joints", 2, "sign")`), or columns of a data set. cure:
    what to do there.
    """

    what: str
    source: Source
    cure: str
    key: tuple[str | int, ...] = ()
    rows: tuple[int, ...] = ()

    def words(self, name: Callable[[int], str]) -> str:
        """`what` with each row called by its `name`."""
        return self.what.format(*map(name, self.rows))


@final
@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Changes that are supposed together. oddity: how far-fetched; between equals the less odd comes first.

    mastering: whether it says no more than that zeros are off by little: that is for the identification to find, and no
    mistake.
    """

    changes: tuple[Change, ...]
    setup: Setup
    complexity: int = 0
    mastering: bool = False
