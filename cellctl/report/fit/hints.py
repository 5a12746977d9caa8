"""Obvious gaps in the rows, as advice: joints that hardly moved, one orientation, no length."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cellctl.kinematics import Floats
from cellctl.report.fit.story import FitStory

STILL_DEG = 40.0
"""A joint that covered less than this has hardly moved."""

_SAME_DEG = 15.0
_ROWS_EACH = 1.5
_PER_POINT = 6


def hints(story: FitStory) -> list[str]:
    """Advice in sentences, most important first; may be empty."""
    return [
        *_length(story),
        *_still_joints(story),
        *_orientation(story),
        *_rarely_visited(story),
        *_sides(story),
        *_counts(story),
    ]


def _still_joints(story: FitStory) -> Iterator[str]:
    used, limits = story.readings[story.used], story.robot.limits()
    for name, covered, (low, high) in zip(story.joints, np.ptp(used, axis=0), limits, strict=True):
        if covered < min(STILL_DEG, 0.25 * (high - low)):
            yield f"{name} covered only {covered:.0f}° of {high - low:.0f}°: spread it."


def _orientation(story: FitStory) -> Iterator[str]:
    """The largest rotation of the tool between any two rows of the fit."""
    rows = story.task.rows.pick(story.used)
    blocks = [block for block in rows.blocks if len(block)]
    turns = [story.found.state.models[block.session].chain.forward(block.q)[:, :3, :3] for block in blocks]
    greatest = max(_greatest_turn(each) for each in turns)
    if greatest < _SAME_DEG:
        yield (
            f"The tool kept its orientation (within {greatest:.0f}°): turn it about all axes, or tool, base and wrist "
            "are separated by their assumed σ alone."
        )


def _greatest_turn(turns: Floats) -> float:
    """Greatest angle, deg, between the first of `turns` (N, 3, 3) and any other."""
    trace = np.einsum("ij,nij->n", turns[0], turns)
    return float(np.rad2deg(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))).max())


def _length(story: FitStory) -> Iterator[str]:
    kinds = story.task.rows.kinds
    if any(kind.of_instrument for kind in kinds) or story.task.spacings is not None:
        return
    if all(kind.of_planes for kind in kinds):
        yield "No length was measured: the robot's scale is its table's. Touch a sphere, or measure a distance."
    elif not any(kind.has_length for kind in kinds):
        yield "No length was measured: the robot's scale is its table's. Certify a distance between two sockets."
    elif not any(kind.of_planes for kind in kinds):
        yield (
            "No distance between points is certified: the robot's scale hangs on the size of the spheres. "
            "Certify a distance between two of them."
        )


def _rarely_visited(story: FitStory) -> Iterator[str]:
    blocks = story.task.rows.pick(story.used).blocks
    for block in blocks:
        if not block.along_line:
            continue
        counts = np.bincount(block.visited[block.visited >= 0], minlength=len(story.task.points))
        rare = [name for name, count in zip(story.task.points, counts, strict=True) if 0 < count < _PER_POINT]
        if rare:
            yield f"Fewer than {_PER_POINT} touches on {', '.join(rare)}: its place takes up three of them."
    kinds = story.task.rows.kinds
    if not any(kind.of_instrument for kind in kinds) and len(story.task.points) == 1:
        yield f"All rows are at {story.task.points[0]}: a second place, far off, shows what one cannot."


def _sides(story: FitStory) -> Iterator[str]:
    blocks = [block for block in story.task.rows.pick(story.used).blocks if len(block)]
    known = [block.postures.approach for block in blocks if block.postures.approach is not None]
    if not known or "backlash" not in story.found.unknowns.groups:
        return
    approach = np.concatenate(known)
    lone = [
        name for name, side in zip(story.joints, approach.T, strict=True) if not (side > 0).any() & (side < 0).any()
    ]
    if lone:
        yield f"{', '.join(lone)} always came from the same side: play is seen only where a joint comes from both."


def _counts(story: FitStory) -> Iterator[str]:
    numbers = story.task.rows.pick(story.used).size
    if numbers < _ROWS_EACH * story.result.n_parameters:
        yield (
            f"{numbers} measured numbers for {story.result.n_parameters} parameters: more rows tell more than any "
            "choice of them."
        )
    if not story.result.n_test:
        yield "No row was held out: nothing on this page is proved. Keep a fifth of the rows for that."
