"""Where fixed things of a cell should be: an exchange over layouts, and how well nests hold an instrument's frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cellctl.kinematics import Floats
from cellctl.planning.design import sigma_of

_BETTER = 0.01
"""Share by which a layout has to be better than another one: nobody moves a stand for less."""

_FREE_MM, _FREE_RAD = 1000.0, 1.0
"""1 σ of an instrument's place and turn before it has measured nests."""


def best_layout(
    start: Sequence[int], places: int, error: Callable[[tuple[int, ...]], float]
) -> tuple[tuple[int, ...], float]:
    """A choice of `places` places in which no single exchange is better, from `start`; and its error.

    error: of a layout, infinite where it is not possible. Each place in turn gives way to the one that is best beside
    the others (as the rows in `design`), until no exchange is better.
    """
    layout = tuple(start)
    least, moved = error(layout), True
    while moved:
        moved = False
        for at in range(len(layout)):
            others = [place for place in range(places) if place not in layout]
            tried = [(*layout[:at], place, *layout[at + 1 :]) for place in others]
            errors = [error(each) for each in tried]
            if errors and min(errors) < (1.0 - _BETTER) * least:
                layout, least, moved = tried[int(np.argmin(errors))], min(errors), True
    return layout, least


def error_by_nests(nests: Floats, sigma_mm: Floats, asked: Floats) -> float:
    """1 σ, 3-D, RMS, mm, of points (N, 3) in the cell's frame, by the frame of an instrument that measures nests at
    (M, 3), mm, with sigma_mm (M,) on each axis.
    """
    rows = (_motions(nests) / sigma_mm[:, None, None]).reshape(-1, 6)
    prior = np.diag([_FREE_MM**-2] * 3 + [_FREE_RAD**-2] * 3)
    covariance = np.asarray(np.linalg.inv(prior + rows.T @ rows))
    moved = _motions(asked).reshape(-1, 6)
    return sigma_of(covariance, moved.T @ moved, len(asked))


def _motions(points: Floats) -> Floats:
    """How points (N, 3) move with three slides and three turns about the origin: (N, 3, 6)."""
    slides = np.broadcast_to(np.eye(3), (len(points), 3, 3))
    turns = np.cross(np.eye(3)[None], points[:, None, :])
    return np.concatenate([slides, np.swapaxes(turns, 1, 2)], axis=2)
