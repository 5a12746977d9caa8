"""What to measure next: rows like the measured ones, chosen by their information."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.calibration import Measured, Parameter
from cellctl.calibration.prediction.predict import shape_columns
from cellctl.kinematics import Floats
from cellctl.planning.next_rows import Advice, next_rows, rows_like
from cellctl.report.fit.region import RegionSigma
from cellctl.report.fit.story import FitStory
from cellctl.report.numbers import MINUS, decimals, fixed

Section = dict[str, Any]

ROWS = 8
CANDIDATES = 512
"""Number of each kind of row."""

_NARROWED = 0.98
"""A parameter is listed if its σ falls to this share or less."""

_NAMED = 3


def advice(story: FitStory, region: RegionSigma) -> Section | None:
    """A table of rows, each with σ after it and the improved parameters. None if no such rows are in reach."""
    blocks = _candidates(story)
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


def _candidates(story: FitStory) -> list[Measured]:
    """Rows like those of the last session, with the estimated scatter of its rows; none without such rows."""
    noise = story.result.identification.noise
    blocks = [block for block in story.task.rows.pick(story.used).noisier(noise).blocks if len(block)]
    last = max(block.session for block in blocks)
    like = [rows_like(block, story.found.state, story.limits, CANDIDATES) for block in blocks if block.session == last]
    return [block for block in like if len(block)]


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
