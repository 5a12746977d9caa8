"""Monument nests measured again and again: did the station move once, is it moving, or did the robot grow?

Nests are fixed to the ground. A motion of the station carries all of them by one rigid transform; growth of the robot
moves none of them. The common part of the points' error is the same each time and is left out; the seating of the
reflector is new each time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.distributions import chi2_sf
from cellctl.kinematics import Floats, inverse_pose
from cellctl.metrology.measured_points import Points, block_diagonal
from cellctl.metrology.measured_pose import MeasuredPose, RigidFit, cross_matrix, rigid_transform

UNLIKELY = 1e-3
"""Probability that a station at rest is said to have moved."""
NEVER = 1e-5
"""Probability that sound nests are called loose, which stops a campaign."""


class NestLoose(ValueError):
    """The nests moved against each other; the text says which one and what to do."""


class StationState(StrEnum):
    """What the station did."""

    STILL = "still"
    MOVED = "moved"
    """Once, between two checks."""
    MOVING = "moving"


@final
@dataclass(frozen=True, eq=False)
class StationMotion:
    """verdict; p_still: probability of the measurements if the station is at rest; p_moved: if it moved once.

    before: checks before the one motion (0 unless `moved`). motion: carries points of the old instrument frame to the
    new one, from the first to the last state. largest_mm: largest displacement of a nest in any check. rate_mm_h: of
    the nests' middle from first to last check. confirmed: at least two checks agree after the motion; otherwise it
    cannot be told from a station that still moves: check once more.
    """

    verdict: StationState
    p_still: float
    p_moved: float
    before: int
    motion: MeasuredPose | None
    largest_mm: float
    rate_mm_h: float
    confirmed: bool


def station_motion(
    checks: Sequence[Points],
    times_s: ArrayLike,
    *,
    seating_mm: float = 0.0,
    tolerance_mm: float = 0.0,
    names: Sequence[str] = (),
) -> StationMotion:
    """Judge K ≥ 2 checks of the same M ≥ 3 nests, in one order, at times (K,), s.

    seating_mm: σ of the reflector's centre in a nest on each axis, new at each seating. tolerance_mm: displacements up
    to this count as still whatever their significance. names: of the nests. Raises NestLoose where even a motion before
    each check does not explain the measurements, and ValueError for too few checks or nests.
    """
    times = np.asarray(times_s, float)
    if len(checks) < 2 or len(times) != len(checks) or len({len(check) for check in checks}) != 1:
        raise ValueError("station motion needs two or more checks of the same nests, and a time for each")
    sets = [_Mean(check.xyz, check.alone + seating_mm**2 * np.eye(3), 0.0, 0) for check in checks]
    own = [_between(sets[0], later) for later in sets[1:]]
    _refuse_loose(sets, own, names)
    largest = max(float(np.linalg.norm(later.xyz - sets[0].xyz, axis=1).max()) for later in sets[1:])
    shift = float(np.linalg.norm(sets[-1].xyz.mean(axis=0) - sets[0].xyz.mean(axis=0)))
    rate = shift / max(float(times[-1] - times[0]), 1e-9) * 3600.0
    still = _mean(sets)
    p_still = float(chi2_sf(still.chi2, still.dof))
    if p_still >= UNLIKELY or largest <= tolerance_mm:
        return StationMotion(StationState.STILL, p_still, 1.0, 0, None, largest, rate, True)
    before, motion, p_moved = _one_step(sets)
    if p_moved >= UNLIKELY:
        confirmed = len(sets) - before >= 2
        return StationMotion(StationState.MOVED, p_still, p_moved, before, motion.pose, largest, rate, confirmed)
    return StationMotion(StationState.MOVING, p_still, p_moved, 0, own[-1].pose, largest, rate, len(sets) > 2)


@final
@dataclass(frozen=True, eq=False)
class Growth:
    """grew: whether robot points moved beyond chance and tolerance, the station's own motion taken off.

    displacement (N, 3), mm, in the old instrument frame, with covariance (3N, 3N); p_value: if the robot is at rest.
    """

    grew: bool
    displacement: Floats
    covariance: Floats
    p_value: float


def robot_growth(
    before: Points, after: Points, motion: MeasuredPose | None = None, *, tolerance_mm: float = 0.0
) -> Growth:
    """Did reflectors on the robot move between two measurements of the same N postures?

    motion: of the station in between, as `StationMotion.motion`; None: it was still.
    """
    back = np.eye(4) if motion is None else inverse_pose(motion.matrix)
    turn = np.kron(np.eye(len(after)), back[:3, :3])
    displacement = after.xyz @ back[:3, :3].T + back[:3, 3] - before.xyz
    covariance = block_diagonal(before.alone) + turn @ block_diagonal(after.alone) @ turn.T
    if motion is not None:
        back_pose = motion.inverse()
        arms = after.xyz @ back[:3, :3].T
        rows = np.concatenate([np.tile(np.eye(3), (len(after), 1, 1)), -cross_matrix(arms)], axis=2).reshape(-1, 6)
        covariance = covariance + rows @ back_pose.covariance @ rows.T
    flat = displacement.ravel()
    p_value = float(chi2_sf(flat @ np.linalg.solve(covariance, flat), flat.size))
    beyond = float(np.linalg.norm(displacement, axis=1).max()) > tolerance_mm
    return Growth(p_value < UNLIKELY and beyond, displacement, covariance, p_value)


@final
@dataclass(frozen=True, eq=False)
class _Mean:
    """Nests' mean places (M, 3), covariances (M, 3, 3), and χ² of what was averaged."""

    xyz: Floats
    covariance: Floats
    chi2: float
    dof: int


def _mean(sets: Sequence[_Mean]) -> _Mean:
    weights = np.linalg.inv(np.stack([one.covariance for one in sets]))
    covariance = np.linalg.inv(weights.sum(axis=0))
    xyz = np.einsum("mij,kmjl,kml->mi", covariance, weights, np.stack([one.xyz for one in sets]))
    away = np.stack([one.xyz for one in sets]) - xyz
    chi2 = float(np.einsum("kmi,kmij,kmj->", away, weights, away))
    return _Mean(xyz, covariance, chi2, xyz.size * (len(sets) - 1))


def _between(old: _Mean, new: _Mean) -> RigidFit:
    """The rigid motion that carries the nests from `old` to `new`, by the covariances of both in the new frame."""
    rough = rigid_transform(old.xyz, new.xyz, block_diagonal(new.covariance))
    turn = rough.pose.matrix[:3, :3]
    return rigid_transform(old.xyz, new.xyz, block_diagonal(new.covariance + turn @ old.covariance @ turn.T))


def _one_step(sets: Sequence[_Mean]) -> tuple[int, RigidFit, float]:
    """The split into two groups with the least χ²: checks before it, the motion, and the probability."""
    best: tuple[float, int, RigidFit, int] | None = None
    for before in range(1, len(sets)):
        old, new = _mean(sets[:before]), _mean(sets[before:])
        motion = _between(old, new)
        chi2, dof = old.chi2 + new.chi2 + motion.chi2, old.dof + new.dof + motion.dof
        if best is None or chi2 < best[0]:
            best = chi2, before, motion, dof
    assert best is not None
    chi2, before, motion, dof = best
    return before, motion, float(chi2_sf(chi2, dof))


def _refuse_loose(sets: Sequence[_Mean], own: Sequence[RigidFit], names: Sequence[str]) -> None:
    worst = min(range(len(own)), key=lambda place: own[place].p_value)
    if own[worst].p_value >= NEVER / len(own):
        return
    old, new = sets[0], sets[worst + 1]
    first, later = (np.linalg.norm(one.xyz[:, None] - one.xyz, axis=-1) for one in (old, new))
    loose = int(((later - first) ** 2).sum(axis=1).argmax())
    name = names[loose] if names else str(loose + 1)
    change = float(np.abs(later - first)[loose].max())
    raise NestLoose(
        f"at check {worst + 2} nest {name} is {change:.3f} mm nearer to or farther from another nest than before: "
        f"the nest is loose or the reflector was not seated; fasten and clean it, and start a new session"
    )
