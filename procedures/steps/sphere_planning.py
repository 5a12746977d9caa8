"""From the cell's artefact and robot file to planned touches."""

from __future__ import annotations

from typing import Any

import numpy as np

from cellctl.files import InputError
from cellctl.formats import RobotFile, artefact_of
from cellctl.formats.artefact import Artefact
from cellctl.planning import OutOfReach, PlannedTouch, SphereTarget, plan_touches
from cellctl.planning.ways import Reach
from cellctl.procedure import StepContext


def planned_touches(context: StepContext, fit: int, held_out: int, names: list[str]) -> list[dict[str, Any]]:
    """Touches as `TouchPlan` takes them; the held-out ones drawn at random, evenly over the spheres.

    Raises InputError where the cell has no such sphere, or too few touches can be reached.
    """
    robot = RobotFile.load(context.robot_file)
    targets = _targets(context, artefact_of(context.cell, ("artefact",)), names)
    counts = _even(fit + held_out, len(targets))
    low, high = robot.limits().T
    reach = Reach(tuple(low.tolist()), tuple(high.tolist()))
    try:
        touches = plan_touches(robot.chain(), robot.joint_map(), reach, targets, counts, context.seed)
    except OutOfReach as error:
        cure = "move the artefact to where the robot reaches all around it, or ask for fewer touches"
        raise InputError(context.cell.problem(("artefact",), str(error), cure)) from error
    sets = _sets(touches, [target.name for target in targets], held_out, context.seed)
    return [_as_dict(number, touch, of) for number, (touch, of) in enumerate(zip(touches, sets, strict=True))]


def _targets(context: StepContext, artefact: Artefact, names: list[str]) -> list[SphereTarget]:
    targets = []
    for name in names or [sphere.id for sphere in artefact.spheres]:
        sphere = artefact.sphere(name)
        if sphere is None:
            known = ", ".join(sphere.id for sphere in artefact.spheres)
            place = ("artefact", "spheres")
            raise InputError(context.cell.problem(place, f"there is no sphere '{name}'", f"known: {known}"))
        x, y, z = sphere.centre
        targets.append(SphereTarget(name, (x, y, z), sphere.diameter / 2 + artefact.tip_radius))
    return targets


def _even(total: int, parts: int) -> list[int]:
    return [total // parts + (index < total % parts) for index in range(parts)]


def _sets(touches: list[PlannedTouch], spheres: list[str], held_out: int, seed: int) -> list[str]:
    """`test` for `held_out` of the touches, evenly over the spheres, at random within each; `fit` for the others."""
    random = np.random.default_rng([seed, 0x7E57])
    sets = ["fit"] * len(touches)
    for sphere, count in zip(spheres, _even(held_out, len(spheres))[::-1], strict=True):
        on_it = [index for index, touch in enumerate(touches) if touch.sphere == sphere]
        for index in random.permutation(on_it)[:count]:
            sets[index] = "test"
    return sets


def _as_dict(number: int, touch: PlannedTouch, of: str) -> dict[str, Any]:
    return {
        "number": number,
        "sphere": touch.sphere,
        "set": of,
        "approach": [list(q) for q in touch.approach],
        "start": list(touch.start),
        "end": list(touch.end),
        "search_mm": touch.search_mm,
        "retreat": [list(q) for q in touch.retreat],
    }
