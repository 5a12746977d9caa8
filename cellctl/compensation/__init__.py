"""Compensation: joint commands that take the real robot to the targets of the nominal one. Arrays in, arrays out.

`compensate(nominal, identified, targets, start)` finds the joints, by one of `METHODS`; `gauge_fixed` gives the part of
a model's covariance that matters for targets relative to touched spheres; `with_geometry` and `with_zeros_and_frames`
give the chain of a controller into which parameters are written.
"""

from cellctl.compensation.compensating import Compensated, compensate
from cellctl.compensation.corrections import METHODS
from cellctl.compensation.nearest_chain import with_frames, with_geometry, with_zeros_and_frames, zeros_of
from cellctl.compensation.postures import postures
from cellctl.compensation.predictors import PredictedErrors
from cellctl.compensation.uncertainty import gauge_fixed

__all__ = [
    "METHODS",
    "Compensated",
    "PredictedErrors",
    "compensate",
    "gauge_fixed",
    "postures",
    "with_frames",
    "with_geometry",
    "with_zeros_and_frames",
    "zeros_of",
]
