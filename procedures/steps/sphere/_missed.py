"""The line that follows a touch which found nothing: to where the touches before show its sphere, by nominal joints.

A touch's line ends `TouchOptions.depth` below the surface that the nominal robot expects. A robot that is farther off
goes past it. The new line is as long as the first one and as deep below the surface that it aims at, so the limits of
a search, and the distance of the tool's shaft from the sphere, are those of any other touch.
"""

from __future__ import annotations

import numpy as np

from cellctl.formats import RobotFile, artefact_of, postures_of
from cellctl.kinematics import Floats
from cellctl.planning import Reach, RobotPostures, TouchOptions, moved_touch
from cellctl.procedure import StepContext
from procedures.steps.sphere.planning import as_plan, as_touch, plate_of, target_of
from procedures.steps.sphere.rows import LocateRow, TouchRow
from procedures.steps.sphere.touch_plans import TouchPlan

_SHIFT_MM, _DISAGREEMENT_MM = 5.0, 1.5
"""1 σ of a sphere's apparent shift by the nominal robot, on each axis, and of its touches about it: of simulated
UR10e, seeds 1 to 7."""

_DEEPER_MM = 1.0
"""A line that ends less than this below the first one, mm, would find nothing either."""


def line_after_miss(context: StepContext, missed: TouchPlan) -> TouchPlan | None:
    """The line to the sphere's apparent place, for the touch `missed`, whose robot is back from it.

    None where the touches before do not explain the miss: there are none on this sphere, whose lead may be off; or by
    them the sphere is not deeper. None, too, where the sphere appears farther off than the planner's clearance, which
    has to cover the robot's error, or the way there is not clear.
    """
    rows = [row for kind in (TouchRow, LocateRow) for row in context.recorded(kind) if row.sphere == missed.sphere]
    if not rows or missed.set == "reference":
        return None
    robot, artefact = RobotFile.load(context.robot_file), artefact_of(context.cell, ("artefact",))
    targets = {sphere.id: target_of(artefact, sphere, {}) for sphere in artefact.spheres}
    chain, joints = robot.chain(), robot.joint_map()
    start, end, *tips = chain.forward(joints.model([missed.start, missed.end, *(row.joints for row in rows)]))[:, :3, 3]
    by = _apparent_shift(np.array(tips) - targets[missed.sphere].centre, targets[missed.sphere].contact_radius)
    inwards = (end - start) / np.linalg.norm(end - start)
    if by @ inwards < _DEEPER_MM or np.linalg.norm(by) > TouchOptions().clearance:
        return None
    low, high = (tuple(limit.tolist()) for limit in robot.limits().T)
    postures = postures_of(context.cell, robot, "touch")
    moved = moved_touch(
        chain,
        joints,
        Reach(low, high),
        RobotPostures(tuple(postures.home), tuple(map(tuple, postures.touch))),
        list(targets.values()),
        as_touch(missed),
        by,
        plate=plate_of(artefact),
    )
    return as_plan(missed.number, moved, missed.set) if moved else None


def _apparent_shift(tips: Floats, reach: float) -> Floats:
    """Shift (3,), mm, of the sphere that explains contacts of the tip at `tips` (N, 3) from its expected centre.

    To first order a shift d makes the touch with the inward normal u come u·d deeper. With few touches the shift across
    their normals is unknown: d ~ N(0, `_SHIFT_MM`²) keeps it small (ridge regression).
    """
    distances = np.linalg.norm(tips, axis=1)
    inwards = -tips / distances[:, None]
    information = inwards.T @ inwards + (_DISAGREEMENT_MM / _SHIFT_MM) ** 2 * np.eye(3)
    return np.asarray(np.linalg.solve(information, inwards.T @ (reach - distances)))
