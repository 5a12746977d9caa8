"""How targets are chosen, and what rejects one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.planning.measuring_poses import Sight

Array = NDArray[np.float64]


@final
@dataclass(frozen=True, slots=True, eq=False)
class TargetOptions:
    """How targets are chosen, and what rejects one.

    near (n,): a posture, deg, whose configuration all targets have; None: the one that reaches most. dense: samples
    from which joint-uniform and near-path choose; None: 20 for each target (at least 2000) and 2000. partitions: of
    each joint, for joint-uniform; None: 20, or as many as the targets can cover. path (P, 3): polyline, mm, for
    near-path; path_points: points on it. sight: what a station must see (frame: that of the robot file), None: no
    station. floor: height, mm, from which links, TCP and reflectors keep `clearance`; None: no floor.
    """

    near: Array | None = None
    dense: int | None = None
    partitions: int | None = None
    path: Array | None = None
    path_points: int = 50
    sight: Sight | None = None
    floor: float | None = None
    clearance: float = 100.0
