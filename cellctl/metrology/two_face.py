"""Limit test of two-face errors: half the difference between an instrument's faces, at the reflector in mm.

The faces reverse collimation, index and tilting-axis errors; an instrument out of adjustment shows them here before a
campaign, and at its end whether they changed (ISO 10360-10 has the same test for laser trackers).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

CURE = "adjust the instrument (check and adjust: collimation, vertical index), then start again"


@final
@dataclass(frozen=True, slots=True)
class TwoFaceLimits:
    """Largest error across the beam at any point, and largest change of it during a campaign, mm."""

    error_mm: float
    change_mm: float


@final
@dataclass(frozen=True, slots=True)
class TwoFaceCheck:
    """passed; worst: index of the worst point; worst_mm: its error; rms_mm; reason: in words why it did not pass."""

    passed: bool
    worst: int
    worst_mm: float
    rms_mm: float
    reason: str


def two_face_check(across_mm: ArrayLike, limits: TwoFaceLimits, before_mm: ArrayLike | None = None) -> TwoFaceCheck:
    """Judge errors (N, 2), horizontal and vertical, mm at the reflector, of N points.

    before_mm (N, 2): of the same points at the start of the campaign; the worst point is then that of the change, if
    the change is the part that does not pass. Raises ValueError for values that are not finite.
    """
    errors = np.atleast_2d(np.asarray(across_mm, float))
    if not np.isfinite(errors).all() or not errors.size:
        raise ValueError("two-face errors are missing or not finite: measure them again")
    length = np.linalg.norm(errors, axis=1)
    rms, worst = float(np.sqrt((length**2).mean())), int(length.argmax())
    if length[worst] > limits.error_mm:
        reason = f"two-face error {length[worst]:.3f} mm at point {worst + 1} is above {limits.error_mm:g} mm: {CURE}"
        return TwoFaceCheck(False, worst, float(length[worst]), rms, reason)
    if before_mm is not None:
        change = np.linalg.norm(errors - np.asarray(before_mm, float), axis=1)
        most = int(change.argmax())
        if change[most] > limits.change_mm:
            reason = (
                f"the two-face error at point {most + 1} changed by {change[most]:.3f} mm since the start, more than "
                f"{limits.change_mm:g} mm: let the instrument reach the room's temperature, {CURE}"
            )
            return TwoFaceCheck(False, most, float(change[most]), rms, reason)
    return TwoFaceCheck(True, worst, float(length[worst]), rms, "")
