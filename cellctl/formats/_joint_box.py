"""The measured region of old model files: the box of the joints alone, without postures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

import numpy as np

from cellctl.kinematics import Floats

MARGIN_RAD = np.deg2rad(2.0)
"""An angle this far outside those of the fit still counts as inside."""

LEAST_HALF_SPAN_RAD = np.deg2rad(10.0)
"""Least half-span: a joint that hardly moved counts as measured over this to either side."""


@final
@dataclass(frozen=True, eq=False)
class JointBox:
    """Least and greatest model angle of each joint, lower (n,) … upper (n,), rad; see `Coverage`."""

    lower: Floats
    upper: Floats

    def joined(self, q: Floats) -> tuple[Self, float]:
        """With angles q (N, n), rad, added; inside the box the remainder is 0."""
        both = np.vstack([q, self.lower, self.upper])
        return type(self)(both.min(axis=0), both.max(axis=0)), 0.0

    def remainder(self, q: Floats) -> Floats:
        """How far outside angles q (N, n), rad, are (N,): the sum over the joints of the fourth power of the distance
        from the box, as a share of half its span, at most 1.

        One half-span outside, a model is trusted no more than nominal. Its errors are smooth, so that nothing changes
        abruptly just outside; within the margin it is 0.
        """
        beyond = np.maximum(np.maximum(self.lower - q, q - self.upper), 0.0)
        halves = np.maximum((self.upper - self.lower) / 2.0, LEAST_HALF_SPAN_RAD)
        shares = np.where(beyond > MARGIN_RAD + 1e-12, np.minimum(beyond / halves, 1.0), 0.0)
        return np.asarray(np.linalg.norm(shares**2, axis=1) ** 2)
