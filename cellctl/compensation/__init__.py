"""Compensation: joint commands that take the real robot to the targets of the nominal one. Arrays in, arrays out.

`compensate(nominal, identified, targets, start)` finds the joints; `gauge_fixed` gives the part of a model's covariance
that matters for targets relative to touched spheres. `cyclic_search` needs predicted position errors alone.
"""

from cellctl.compensation.compensating import Compensated, compensate
from cellctl.compensation.corrections import METHODS
from cellctl.compensation.cyclic_search import Searched, cyclic_search
from cellctl.compensation.postures import postures
from cellctl.compensation.uncertainty import gauge_fixed

__all__ = ["METHODS", "Compensated", "Searched", "compensate", "cyclic_search", "gauge_fixed", "postures"]
