"""What to measure next: obvious gaps in the rows, and rows like the measured ones, chosen by their information."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from cellctl.calibration import Measured, Parameter
from cellctl.calibration.prediction.predict import shape_columns
from cellctl.kinematics import Floats
from cellctl.planning.next_rows import Advice, next_rows, rows_like
from cellctl.report.figures import MINUS, decimals, fixed
from cellctl.report.fit._region import RegionSigma
from cellctl.report.fit._story import FitStory

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
    units = story.robot.joint_map().units
    for number, (unit, covered, (low, high)) in enumerate(zip(units, np.ptp(used, axis=0), limits, strict=True), 1):
        mm = " mm" if unit == "mm" else unit
        if covered < min(STILL_DEG if unit == "°" else np.inf, 0.25 * (high - low)):
            yield f"A{number} covered only {covered:.0f}{mm} of {high - low:.0f}{mm}: spread it."


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


Section = dict[str, Any]

ROWS = 8
CANDIDATES = 512
"""Number of each kind of row."""

_NARROWED = 0.98
"""A parameter is listed if its σ falls to this share or less."""

_NAMED = 3


def advice(story: FitStory, region: RegionSigma, blocks: list[Measured]) -> Section | None:
    """A table of rows of `blocks`, each with σ after it and the improved parameters. None without such rows."""
    if not blocks:
        return None
    found = story.found
    columns = _columns(blocks, story)
    asked = shape_columns(found.state.model, region.postures)
    everything = np.zeros((len(asked), found.covariance.shape[0]))
    everything[:, : asked.shape[1]] = asked
    advised = next_rows(found.covariance, everything, columns, ROWS).beside(region.besides)
    starts = np.cumsum([0, *(len(block) for block in blocks)])
    rows = []
    for place, chosen in enumerate(advised.chosen):
        block = int(np.searchsorted(starts, chosen, side="right")) - 1
        row = blocks[block].pick(np.array([chosen - starts[block]]))
        rows.append(_row(story, row, advised, place))
    return {
        "rows": rows,
        "joints": story.joints,
        "now": _alike(advised.sigma_mm[0], advised),
        "after": _alike(advised.sigma_mm[-1], advised),
        "at_random": _alike(advised.at_random_mm, advised),
        "candidates": len(columns),
        "session": story.sessions[blocks[0].session] if len(story.task.sessions) > 1 else "",
        "sides": any(row["sides"] for row in rows),
        "touches": any(
            bool((block.visited >= 0).any()) and block.along_line and not block.of_planes for block in blocks
        ),
    }


def candidates(story: FitStory) -> tuple[list[Measured], list[str]]:
    """Rows like those of the last session, with the estimated scatter of its rows; and a sentence for each kind of rows
    that states none.
    """
    noise = story.result.identification.noise
    blocks = [block for block in story.task.rows.pick(story.used).noisier(noise).blocks if len(block)]
    last = max(block.session for block in blocks)
    mine = [block for block in blocks if block.session == last]
    like = [rows_like(block, story.found.state, story.limits, CANDIDATES) for block in mine]
    skipped = {block.many: None for block, each in zip(mine, like, strict=True) if each is None}
    found = [each for each in like if each is not None and len(each)]
    return found, [f"No {name} are proposed: such rows do not state where they can be measured." for name in skipped]


def _columns(blocks: list[Measured], story: FitStory) -> Floats:
    """Jacobians (M, k, P) in standard deviations; shorter ones are padded with zeros."""
    each = [block.jacobian(story.found.state) / block.sigma[..., None] for block in blocks]
    most = max(columns.shape[1] for columns in each)
    return np.concatenate([np.pad(columns, ((0, 0), (0, most - columns.shape[1]), (0, 0))) for columns in each])


def _row(story: FitStory, row: Measured, advised: Advice, place: int) -> Section:
    readings = story.robot.joint_map().readings(row.q)[0]
    sides = row.postures.approach
    signs = story.robot.joint_map().sign
    return {
        "what": _what(story, row),
        "readings": [f"{value:.1f}".replace("-", MINUS) for value in readings],
        "sides": "".join("+" if side > 0 else MINUS for side in sides[0] * signs) if sides is not None else "",
        "sigma": _alike(advised.sigma_mm[place + 1], advised),
        "narrows": narrows(story.found.unknowns.parameters, advised.narrowed[place]),
    }


def _alike(sigma: float, advised: Advice) -> str:
    """σ with enough decimals to show the smallest with three digits."""
    return fixed(float(sigma), decimals(float(advised.sigma_mm[-1]), 3))


def _what(story: FitStory, row: Measured) -> str:
    point = int(row.visited[0])
    return str(story.task.points[point]) if point >= 0 else ""


def narrows(parameters: tuple[Parameter, ...], narrowed: Floats) -> str:
    """The parameters (P,) with the largest reduction of σ, and its size: `θ4 by 31 %, tool Z by 12 %`."""
    order = np.argsort(narrowed, kind="stable")[:_NAMED]
    named = [
        f"{parameters[at].label} by {100.0 * (1.0 - narrowed[at]):.0f}\N{NO-BREAK SPACE}%"
        for at in order
        if narrowed[at] <= _NARROWED
    ]
    return ", ".join(named) or "many a little"
