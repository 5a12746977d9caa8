"""Where a model never was: how much less it is to be trusted at joints that its rows did not reach."""

from __future__ import annotations

import numpy as np

from cellctl.kinematics import Floats

MARGIN_RAD = np.deg2rad(2.0)
"""An angle this far outside those of the fit still counts as seen."""

LEAST_HALF_SPAN_RAD = np.deg2rad(10.0)
"""A joint that hardly moved is taken to have been seen over this to either side, for what follows."""


def doubt(lower: Floats, upper: Floats, q: Floats) -> Floats:
    """How far outside the joint region lower (n,) … upper (n,) angles q (N, n) are, all in rad (N,): for each joint the
    square of its share of half the span that was seen, at most 1; over the joints the root of the summed squares.

    One half-span outside, a model is trusted no more than nominal: its doubt is to be multiplied by nominal's error.
    What it lacks is smooth, so that just outside nothing changes at once; within the margin it is 0.
    """
    beyond = np.maximum(np.maximum(lower - q, q - upper), 0.0)
    halves = np.maximum((upper - lower) / 2.0, LEAST_HALF_SPAN_RAD)
    shares = np.where(beyond > MARGIN_RAD + 1e-12, np.minimum(beyond / halves, 1.0), 0.0)
    return np.asarray(np.linalg.norm(shares**2, axis=1))
