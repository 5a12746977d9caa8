"""The campaign that touches spheres: the steps of the family `sphere`."""

from procedures.steps.sphere._proving import compensate, judge, plan_proof, push, standoff, withdraw
from procedures.steps.sphere.converging import convergence
from procedures.steps.sphere.touching import identify, plan, touch

__all__ = [
    "compensate",
    "convergence",
    "identify",
    "judge",
    "plan",
    "plan_proof",
    "push",
    "standoff",
    "touch",
    "withdraw",
]
