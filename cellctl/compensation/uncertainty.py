"""What of a model's uncertainty counts for targets that are given in the model's own frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellctl.kinematics import Floats

GAUGE = ("theta1", "d1")
"""Heading and height of the base: a turn about the first axis, or a slide along it, moves the robot and all that it
touched alike."""


def gauge_fixed(covariance: Floats, names: Sequence[str]) -> Floats:
    """The covariance (P, P) of parameters `names` (P,), given that θ1 and d1 are as they came out.

    No touch can see these two: whatever they are, the centres go with them. A tool's place *relative to these centres*
    is therefore as sure as if they were known, Σ_aa − Σ_ab Σ_bb⁻¹ Σ_ba, while its place in a base that somebody else
    measured is not. Zero for parameters that were held.
    """
    chosen = [index for index, name in enumerate(names) if name in GAUGE and covariance[index, index] > 0.0]
    if not chosen:
        return covariance
    columns = covariance[:, chosen]
    return np.asarray(covariance - columns @ np.linalg.solve(covariance[np.ix_(chosen, chosen)], columns.T))
