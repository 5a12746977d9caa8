"""Compensation: what to command so that the real robot goes where the nominal one was meant to. Arrays in, arrays out.

`compensate(nominal, identified, targets, start)` finds the joints; `gauge_fixed` is what of a model's covariance counts
for targets that are given where touched spheres are.
"""

from cellctl.compensation.postures import postures
from cellctl.compensation.pseudo_target import METHODS, Compensated, compensate
from cellctl.compensation.uncertainty import gauge_fixed

__all__ = ["METHODS", "Compensated", "compensate", "gauge_fixed", "postures"]
