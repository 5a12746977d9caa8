"""Plans touches on one sphere with several tool orientations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellctl.files import InputError
from cellctl.formats import RobotFile, artefact_of, postures_of
from cellctl.planning import OutOfReach, RobotPostures
from cellctl.planning.shared_orientations import plan_oriented_touches
from cellctl.planning.ways import Reach
from cellctl.procedure import CellContext
from procedures.steps.sphere.planning import as_plan, plate_of, seed_for, sphere_called, target_of
from procedures.steps.tool.plans import ToolTouchPlan


def planned_touches(
    context: CellContext, sphere: str, orientations: int, held_out: int, touches: int
) -> list[ToolTouchPlan]:
    """`touches` touches on `sphere` with each of `orientations` + `held_out` orientations, the last ones held out.

    Raises InputError if the cell has no such sphere, or too few orientations are in reach.
    """
    artefact = artefact_of(context.cell, ("artefact",))
    robot = RobotFile.load(context.robot_file)
    touched = artefact.spheres.index(sphere_called(context, artefact, sphere))
    postures = postures_of(context.cell, robot, "touch")
    low, high = robot.limits().T.tolist()
    try:
        found = plan_oriented_touches(
            robot.chain(),
            robot.joint_map(),
            Reach(tuple(low), tuple(high)),
            RobotPostures(tuple(postures.home), tuple(map(tuple, postures.touch))),
            [target_of(artefact, each, {}) for each in artefact.spheres],
            touched,
            orientations + held_out,
            touches,
            seed_for(context, "tool"),
            plate=plate_of(artefact),
        )
    except OutOfReach as error:
        cure = "move the sphere to where the robot reaches all around it, or ask for fewer orientations or touches"
        raise InputError(context.cell.problem(("artefact", "spheres", touched), str(error), cure)) from error
    return [
        ToolTouchPlan(
            **as_plan(number, each.touch, "fit" if each.orientation < orientations else "test").model_dump(),
            orientation=each.orientation,
        )
        for number, each in enumerate(found)
    ]


def check_plan(context: CellContext, known: Mapping[str, Any]) -> None:
    """Raise InputError if the touches for `tool.plan` cannot be planned."""
    wanted = ("sphere", "orientations", "held_out", "touches")
    if set(wanted) <= known.keys():
        planned_touches(context, *(known[name] for name in wanted))
