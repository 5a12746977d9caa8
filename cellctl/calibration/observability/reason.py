"""Possible reasons for unobservable parameters: in words, with the rows as they would be without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from cellctl.calibration.model.unknowns import State, Unknowns
from cellctl.calibration.observability.other_postures import lines, thinned
from cellctl.calibration.rows import Measured, SpacingRows
from cellctl.kinematics import Floats, rotation_vector

MOVED_RAD = 0.8
"""Assumed motion of joints."""

TURNS = 20_000
"""Rows of a block, at most, that decide whether orientation changes."""


@final
@dataclass(frozen=True, eq=False)
class Reason:
    """words: `joint 3 never moves in these rows`. lines: derivative of rows without this reason by the free unknowns
    (K, F), in their σ per tolerance. of_frames: whether it only affects base, tool or points.
    """

    words: str
    lines: Callable[[], Floats]
    of_frames: bool = False


@final
@dataclass(frozen=True, eq=False)
class Rowed:
    """Rows of a fit, with its unknowns at their start."""

    unknowns: Unknowns
    blocks: tuple[Measured, ...]
    spacings: SpacingRows | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "blocks", tuple(block for block in self.blocks if len(block)))

    @property
    def state(self) -> State:
        """Robot and points at their start."""
        return self.unknowns.start

    @property
    def q(self) -> Floats:
        """Angles (M, n) of all rows, rad."""
        return np.concatenate([block.q for block in self.blocks])

    def as_they_are(self) -> Floats:
        """Lines of some of the rows."""
        return self.otherwise(lambda block: block)()

    def otherwise(self, change: Callable[[Measured], Measured]) -> Callable[[], Floats]:
        """Lines of the rows, each block changed by `change`."""
        return lambda: lines(self.unknowns, [change(thinned(block)) for block in self.blocks])

    @property
    def lengthless(self) -> bool:
        """Whether nothing but sockets and planes was measured, and no distance between sockets is known."""
        return self.spacings is None and not any(block.has_length for block in self.blocks)

    def points(self) -> list[int]:
        """The visited points, without planes."""
        at = [block.visited for block in self.blocks if not block.of_planes]
        return sorted({int(point) for points in at for point in points if point >= 0})

    @cached_property
    def turns(self) -> Floats:
        """Rotation vectors (M, 3) of the tool from its orientation in the first row of each session, rad; a sample of
        very many rows.
        """
        some = [block.pick(np.s_[:: 1 + len(block) // TURNS]) for block in self.blocks]
        poses = [self.state.models[block.session].pose(block.postures)[:, :3, :3] for block in some]
        first = {block.session: each[0] for block, each in zip(reversed(some), reversed(poses), strict=True)}
        turned = [np.matmul(each, first[block.session].T) for block, each in zip(some, poses, strict=True)]
        return np.concatenate([rotation_vector(each) for each in turned])
