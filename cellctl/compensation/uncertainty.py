"""The part of a model's uncertainty that matters for targets given in the model's own frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellctl.kinematics import Floats

GAUGE = ("theta1", "d1")
"""Heading and height of the base: a turn about the first axis, or a slide along it, moves the robot and all touched
points equally."""


def gauge_fixed(covariance: Floats, names: Sequence[str]) -> Floats:
    """The covariance (P, P) of parameters `names` (P,), given the estimated θ1 and d1.

    These two are unobservable in touches: the centres move with them. The place of a TCP *relative to these centres* is
    therefore as precise as if they were known, Σ_aa − Σ_ab Σ_bb⁻¹ Σ_ba; its place in a base measured by other means is
    not. Zero for parameters that were held.
    """
    chosen = [index for index, name in enumerate(names) if name in GAUGE and covariance[index, index] > 0.0]
    if not chosen:
        return covariance
    columns = covariance[:, chosen]
    return np.asarray(covariance - columns @ np.linalg.solve(covariance[np.ix_(chosen, chosen)], columns.T))
