"""A stratified sample of many rows: small blocks and rare points complete, large ones thinned.

A uniform sample would have six of thirty-six touches beside twenty thousand positions: too few to detect an outlier.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.calibration.rows.row_blocks import RowBlocks


def sampled(rows: RowBlocks, most: int) -> Any:
    """Indices, ascending, of `most` of the `rows` (all, if these are fewer), at random: equally many of each block, and
    within it of each point, as far as it has them.
    """
    rng = np.random.default_rng(len(rows))
    chosen = [np.zeros(0, int)]
    shares = _shared([len(block) for block in rows.blocks], most)
    for (block, mine, _), share in zip(rows.parts(), shares, strict=True):
        order = rng.permutation(len(block))
        point = block.visited[order]
        points, sizes = np.unique(point, return_counts=True)
        for each, own in zip(points, _shared(sizes, share), strict=True):
            chosen.append(mine.start + order[point == each][:own])
    return np.sort(np.concatenate(chosen))


def _shared(sizes: Any, most: int) -> Any:
    """How many of each of `sizes` (S,) make `most`: all of small ones, and as many of each of the others."""
    result = np.zeros(len(sizes), int)
    for done, place in enumerate(np.argsort(sizes, kind="stable")):
        result[place] = min(sizes[place], (most - result.sum()) // (len(sizes) - done))
    return result
