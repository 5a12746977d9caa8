"""Compensation: joint commands that take the real robot to the targets of the nominal one. Arrays in, arrays out.

`compensate(nominal, identified, targets, start)` finds the joints, by one of `METHODS`; `with_geometry` and
`with_zeros_and_frames` give the chain of a controller into which parameters are written.
"""

from cellctl.compensation._compensating import Compensated, compensate
from cellctl.compensation._corrections import (
    METHODS,
    MappedErrors,
    Method,
    Pass,
    PredictedErrors,
    Predictor,
    with_frames,
    with_geometry,
    with_zeros_and_frames,
    zeros_of,
)
from cellctl.compensation.postures import postures

__all__ = [
    "METHODS",
    "Compensated",
    "MappedErrors",
    "Method",
    "Pass",
    "PredictedErrors",
    "Predictor",
    "compensate",
    "postures",
    "with_frames",
    "with_geometry",
    "with_zeros_and_frames",
    "zeros_of",
]
