"""Plans the touches that locate the proof sphere, and the stand-offs, within the joints of the fit."""

from __future__ import annotations

from cellctl.formats import ModelFile, artefact_of
from cellctl.planning import PlannedTouch, TouchOptions
from cellctl.planning.ways import Reach
from cellctl.procedure import StepContext
from procedures.steps.sphere.planning import as_plan, plan_on, seed_for, sphere_called
from procedures.steps.sphere.reference_touches import last_number
from procedures.steps.sphere.rows import ReferenceRow, SphereVerdict, TouchRow
from procedures.steps.sphere.touch_plans import TouchPlan

_BEYOND_MM = 8.0
"""Depth below the expected surface at which a stand-off's search ends without contact."""


def worth_proving(context: StepContext) -> bool:
    """Whether the identified model was better than nominal on the held-out touches."""
    verdicts = context.recorded(SphereVerdict)
    return bool(verdicts) and verdicts[-1].better


def locating_touches(context: StepContext, sphere: str, count: int, tried: int) -> list[TouchPlan]:
    """The touches, with numbers after those already made. Raises InputError.

    tried: see `TouchOptions`. With few touches on one side, the nominal robot's errors there would shift the centre.
    """
    sphere_called(context, artefact_of(context.cell, ("artefact",)), sphere)
    options = TouchOptions(tried=tried)
    touches = plan_on(context, {sphere: count}, seed_for(context, "locate"), reach=_seen(context), options=options)
    first = 1 + last_number(context, TouchRow, ReferenceRow)
    return [as_plan(first + index, touch, "locate") for index, touch in enumerate(touches)]


def standoff_lines(
    context: StepContext,
    sphere: str,
    centre: tuple[float, float, float],
    count: int,
    distance_mm: float,
    reference_every: int,
    reference: PlannedTouch,
) -> list[PlannedTouch]:
    """Lines from `distance_mm` off the surface of `sphere` at `centre`, by the nominal robot. Raises InputError."""
    return plan_on(
        context,
        {sphere: count},
        seed_for(context, "standoff"),
        centres={sphere: centre},
        reach=_seen(context),
        options=standoff_options(distance_mm),
        reference_every=reference_every,
        reference=reference,
    )


def standoff_options(distance_mm: float) -> TouchOptions:
    """How to plan stand-offs from `distance_mm` off the surface."""
    return TouchOptions(guard=distance_mm, depth=_BEYOND_MM)


def _seen(context: StepContext) -> Reach:
    """The joint range of the fit: outside it the model extrapolates, and no table may go there."""
    region = ModelFile.load(context.artefact("model.json")).joint_region
    return Reach(tuple(region.min), tuple(region.max), margin=0.0)
