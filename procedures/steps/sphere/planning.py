"""Plans touches from the cell's artefact and robot file: for the fit, and on the proof sphere with its stand-offs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from hashlib import sha256
from typing import Any

import numpy as np

from cellctl.files import InputError
from cellctl.formats import Artefact, ModelFile, RobotFile, Sphere, artefact_of, postures_of
from cellctl.planning import (
    BestTouches,
    Obstacles,
    OutOfReach,
    PlannedTouch,
    Plate,
    Reach,
    RobotPostures,
    SphereTarget,
    TouchOptions,
    plan_touches,
    spheres_of,
)
from cellctl.procedure import CellContext, StepContext
from procedures.steps.sphere.checked_touches import checked_words
from procedures.steps.sphere.plan_inputs import Choice, PlanInputs
from procedures.steps.sphere.reference_touches import last_number
from procedures.steps.sphere.rows import ReferenceRow, SphereVerdict, TouchRow
from procedures.steps.sphere.touch_choice import TouchChoice
from procedures.steps.sphere.touch_plans import TouchPlan, TouchSet

_REMEMBERED = 8
_PLANNED: dict[str, list[PlannedTouch]] = {}
"""The last plans, by all that they follow from: what a check before the run plans, the run need not plan again."""


CANDIDATES, CANDIDATES_EACH = 600, 8
"""Candidates of an optimal choice: at least so many in all, and for each touch of the fit."""


def planned_touches(
    context: CellContext,
    fit: int,
    held_out: int,
    names: Sequence[str],
    reference_every: int,
    choice: Choice = "even",
    use_distances: bool = True,
) -> list[TouchPlan]:
    """The touches; the held-out ones drawn at random, evenly over the spheres `names` (or all).

    Those of the fit are spread evenly too, or, `optimal`, chosen (`TouchChoice`). After each `reference_every` (0:
    never) follows a return to the first. Raises InputError if the cell has no such sphere, or too few touches are in
    reach.
    """
    spheres = spheres_named(context, names)
    if choice == "optimal":
        return _best_touches(context, fit, held_out, spheres, reference_every, use_distances)
    counts = dict(zip(spheres, even_counts(fit + held_out, len(spheres)), strict=True))
    touches = plan_on(context, counts, context.seed, reference_every=reference_every)
    sets = _sets(touches, spheres, held_out, context.seed)
    return [as_plan(number, touch, of) for number, (touch, of) in enumerate(zip(touches, sets, strict=True))]


def _best_touches(
    context: CellContext, fit: int, held_out: int, spheres: Sequence[str], reference_every: int, use_distances: bool
) -> list[TouchPlan]:
    """Held-out touches as ever, apart from the choice; those of the fit the best of many candidates."""
    artefact = artefact_of(context.cell, ("artefact",))
    names = tuple(sphere.id for sphere in artefact.spheres)
    more = dict(zip(spheres, even_counts(max(CANDIDATES, CANDIDATES_EACH * fit), len(spheres)), strict=True))
    choose = TouchChoice(RobotFile.load(context.robot_file), artefact, names, fit, use_distances)
    touches = plan_on(
        context,
        dict(zip(spheres, even_counts(held_out, len(spheres))[::-1], strict=True)),
        context.seed,
        reference_every=reference_every,
        best=BestTouches(tuple(more.get(name, 0) for name in names), choose),
    )
    return [as_plan(number, touch, "fit" if touch.chosen else "test") for number, touch in enumerate(touches)]


def checked(context: CellContext, touches: Sequence[TouchPlan], use_distances: bool) -> str:
    """What is said of how far the touches of the fit check each other."""
    fit = [touch for touch in touches if touch.set == "fit"]
    robot, artefact = RobotFile.load(context.robot_file), artefact_of(context.cell, ("artefact",))
    ends = np.array([touch.end for touch in fit])
    return checked_words(robot, artefact, [touch.sphere for touch in fit], ends, use_distances)


def plan_on(
    context: CellContext,
    counts: dict[str, int],
    seed: int,
    *,
    centres: dict[str, tuple[float, float, float]] | None = None,
    reach: Reach | None = None,
    options: TouchOptions | None = None,
    reference_every: int = 0,
    reference: PlannedTouch | None = None,
    best: BestTouches | None = None,
) -> list[PlannedTouch]:
    """`counts[name]` touches on each sphere, by paths clear of all spheres of the cell and their plate.

    See `cellctl.planning.plan_touches`.

    `centres`: better centres than the cell file's, if known; `reach`: allowed joint readings, else the
    robot's limits. Raises InputError if too few are in reach, or the cell file has no postures.
    """
    artefact = artefact_of(context.cell, ("artefact",))
    robot = RobotFile.load(context.robot_file)
    targets = [target_of(artefact, sphere, centres or {}) for sphere in artefact.spheres]
    low, high = robot.limits().T
    postures = postures_of(context.cell, robot, "touch")
    work = partial(
        plan_touches,
        robot.chain(),
        robot.joint_map(),
        reach or Reach(tuple(low.tolist()), tuple(high.tolist())),
        RobotPostures(tuple(postures.home), tuple(map(tuple, postures.touch))),
        targets,
        [counts.get(target.name, 0) for target in targets],
        seed,
        options,
        plate=plate_of(artefact),
        reference_every=reference_every,
        reference=reference,
        best=best,
    )
    key = repr((robot, work.args[2:], work.keywords))
    try:
        if key not in _PLANNED:
            while len(_PLANNED) >= _REMEMBERED:
                _PLANNED.pop(next(iter(_PLANNED)))
            _PLANNED[key] = work()
        return list(_PLANNED[key])
    except OutOfReach as error:
        cure = "move the artefact to where the robot reaches all around it, or ask for fewer touches"
        raise InputError(context.cell.problem(("artefact",), str(error), cure)) from error


def check_plan(context: CellContext, known: Mapping[str, Any], names: Sequence[str]) -> None:
    """Raise InputError if the touches for `sphere.plan` cannot be planned."""
    wanted = {"fit", "held_out", "reference_every", "choice", "use_distances"}
    if wanted <= known.keys():
        asked, every = PlanInputs(**known), known["reference_every"]
        choice: Choice = "optimal" if asked.goal_mm else asked.choice
        planned_touches(context, asked.at_first, asked.held_out_at_first, names, every, choice, asked.use_distances)
    else:
        spheres_named(context, names)


def check_on_sphere(
    context: CellContext, sphere: str | None, count: int | None, options: TouchOptions | None = None
) -> None:
    """Raise InputError if `sphere` does not exist, or the nominal robot cannot reach `count` touches on it.

    None: not known yet. In the run fewer are in reach: those within the joints of the fit.
    """
    if sphere is None:
        return
    spheres_named(context, [sphere])
    if count is not None:
        plan_on(context, {sphere: count}, context.seed, options=options)


def assumption(context: CellContext) -> str | None:
    """The assumption made for data missing in the cell file; None if they are there."""
    artefact = artefact_of(context.cell, ("artefact",))
    if artefact.plate:
        return None
    plate = plate_of(artefact)
    return (
        f"the cell file names no plate under the spheres: ways are kept clear of one at z {plate.z:.0f} mm, and of "
        f"stems with a radius of {plate.stem_radius:.0f} mm straight below the spheres"
    )


def sphere_called(context: CellContext, artefact: Artefact, name: str) -> Sphere:
    """The cell's sphere of that name. Raises InputError."""
    sphere = artefact.sphere(name)
    if sphere is None:
        known = ", ".join(sphere.id for sphere in artefact.spheres)
        place = ("artefact", "spheres")
        raise InputError(context.cell.problem(place, f"there is no sphere '{name}'", f"known: {known}"))
    return sphere


def spheres_named(context: CellContext, names: Sequence[str]) -> list[str]:
    """The spheres called `names`, or all if none is named. Raises InputError if one does not exist."""
    artefact = artefact_of(context.cell, ("artefact",))
    return [sphere_called(context, artefact, name).id for name in names] or [each.id for each in artefact.spheres]


def seed_for(context: CellContext, purpose: str) -> int:
    """A separate seed for each purpose, derived from the run's."""
    return int.from_bytes(sha256(f"{context.seed}/{purpose}".encode()).digest()[:4])


def as_plan(number: int, touch: PlannedTouch, of: TouchSet, repeats: int = 0) -> TouchPlan:
    """A planned touch for the steps that move; a reference touch ignores the set in `of`, and repeats `repeats`."""
    return TouchPlan(
        number=number,
        sphere=touch.sphere,
        set="reference" if touch.reference else of,
        origin=list(touch.origin),
        approach=[list(q) for q in touch.approach],
        start=list(touch.start),
        end=list(touch.end),
        search_mm=touch.search_mm,
        retreat=[list(q) for q in touch.retreat],
        repeats=repeats if touch.reference else None,
    )


def as_touch(plan: TouchPlan) -> PlannedTouch:
    """The planned touch of `as_plan`, to be made again."""
    approach, retreat = (tuple(tuple(q) for q in way) for way in (plan.approach, plan.retreat))
    return PlannedTouch(
        plan.sphere, tuple(plan.origin), approach, tuple(plan.start), tuple(plan.end), plan.search_mm, retreat
    )


def spheres_around(context: CellContext) -> Obstacles | None:
    """The cell's spheres at their rough places, with stems and plate; None for a cell without spheres."""
    if "artefact" not in context.cell.data:
        return None
    artefact = artefact_of(context.cell, ("artefact",))
    targets = [target_of(artefact, sphere, {}) for sphere in artefact.spheres]
    return Obstacles(spheres_of(targets), plate_of(artefact)) if targets else None


def plate_of(artefact: Artefact) -> Plate:
    """The plate under the spheres: the cell file's, else an assumed one."""
    if artefact.plate:
        return Plate(artefact.plate.z, artefact.plate.stem_radius)
    return Plate.assumed(np.array([[*sphere.centre, sphere.diameter / 2] for sphere in artefact.spheres]))


def target_of(artefact: Artefact, sphere: Sphere, centres: dict[str, tuple[float, float, float]]) -> SphereTarget:
    """What to touch on `sphere`: at its centre among `centres` (mm), else at its rough place."""
    x, y, z = sphere.centre
    return SphereTarget(sphere.id, centres.get(sphere.id, (x, y, z)), sphere.diameter / 2 + artefact.tip_radius)


def even_counts(total: int, parts: int) -> list[int]:
    """`total` in so many parts, the first ones larger by 1 where they are not equal."""
    return [total // parts + (index < total % parts) for index in range(parts)]


def _sets(touches: list[PlannedTouch], spheres: list[str], held_out: int, seed: int) -> list[TouchSet]:
    """`test` for `held_out` of the touches, evenly over the spheres, at random within each; `fit` for the others."""
    random = np.random.default_rng([seed, 0x7E57])
    sets: list[TouchSet] = ["fit"] * len(touches)
    for sphere, count in zip(spheres, even_counts(held_out, len(spheres))[::-1], strict=True):
        on_it = [index for index, touch in enumerate(touches) if touch.sphere == sphere and not touch.reference]
        for index in random.permutation(on_it)[:count]:
            sets[index] = "test"
    return sets


BEYOND_MM = 8.0
"""Depth below the expected surface at which a stand-off's search ends without contact, if the robot is not far off."""


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
    options: TouchOptions,
    reference_every: int,
    reference: PlannedTouch,
) -> list[PlannedTouch]:
    """Lines by `options` to the surface of `sphere` at `centre`, by the nominal robot. Raises InputError."""
    return plan_on(
        context,
        {sphere: count},
        seed_for(context, "standoff"),
        centres={sphere: centre},
        reach=_seen(context),
        options=options,
        reference_every=reference_every,
        reference=reference,
    )


def standoff_options(distance_mm: float, below_mm: float = BEYOND_MM) -> TouchOptions:
    """How to plan stand-offs from `distance_mm` off the surface to `below_mm` below it."""
    return TouchOptions(guard=distance_mm, depth=below_mm)


def _seen(context: StepContext) -> Reach:
    """The joint range of the fit: outside it the model extrapolates, and no table may go there."""
    region = ModelFile.load(context.artefact("model.json")).joint_region
    return Reach(tuple(region.min), tuple(region.max), margin=0.0)
