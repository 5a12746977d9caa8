"""Error maps: measured position errors interpolated over the joints, without a model of the robot."""

from __future__ import annotations

from typing import Protocol

from cellctl.kinematics import Floats


class ErrorMap(Protocol):
    """Predicted position errors, actual − nominal."""

    def errors(self, q: Floats) -> Floats:
        """Error of the TCP (N, 3), mm, in the frame of the measured errors, at model angles q (N, n), rad."""
        ...


class ErrorMapMethod(Protocol):
    """A way to make an error map from measured errors."""

    def fit(self, q: Floats, errors: Floats) -> ErrorMap:
        """The map of errors (N, 3), mm, measured at model angles q (N, n), rad. Raises UnusableSamples, a
        ValueError with the cure, for rows that make no map.
        """
        ...
