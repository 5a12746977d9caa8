"""Touches planned on one sphere; from touches or poses to the tool, its σ, its verdict on held-out ones, its text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, final

import numpy as np

from cellctl.calibration import ErrorFigures, Verdict, compared_errors, paired_verdict, sphere_centre
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, artefact_of, plain_number, postures_of
from cellctl.kinematics import Floats
from cellctl.metrology import FoundTool, tips, tool_at_point, tool_by_touches, touch_residuals
from cellctl.planning import OutOfReach, Reach, RobotPostures, plan_oriented_touches
from cellctl.procedure import CellContext, StepContext, StepResult
from cellctl.records import Figures
from procedures.steps.sphere.planning import as_plan, plate_of, seed_for, sphere_called, target_of
from procedures.steps.sphere.reference_touches import touch_sigma_mm
from procedures.steps.sphere.touch_plans import TouchPlan
from procedures.steps.tool.rows import ToolErrorsRow, ToolFigures, ToolPoseRow, ToolTouchRow, ToolVerdict


class ToolTouchPlan(TouchPlan):
    """A planned touch and the number of its tool orientation, from 0."""

    orientation: int


class Solved(StepResult):
    """The verdict on held-out contacts, and the found offset of the tool in the flange frame, mm."""

    verdict: str
    sentence: str
    tool: list[float]


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


_NUMBERS_PER_ORIENTATION = 3
"""Touches of one orientation share an error, a vector: they count as three at most."""


@final
@dataclass(frozen=True)
class Solution:
    """A found tool as it is recorded: text of `tool.yaml`, errors of each contact, verdict."""

    text: str
    errors: ToolErrorsRow
    verdict: ToolVerdict


async def record_solution(context: StepContext, found: Solution) -> Solved:
    """Write `tool.yaml`, record the rows, return the step's result."""
    await context.write_artefact("tool.yaml", found.text)
    await context.record(found.errors)
    await context.record(found.verdict)
    verdict = found.verdict
    return Solved(verdict=verdict.verdict, sentence=verdict.sentence, tool=list(verdict.tool.found))


def tool_of_touches(context: StepContext) -> Solution:
    """The tool from the touches of the fit's orientations, judged on those of the held-out ones. Raises InputError."""
    robot, rows = RobotFile.load(context.robot_file), context.recorded(ToolTouchRow)
    flanges, taught = _flanges(robot, [row.joints for row in rows]), np.array(robot.tool.xyz)
    reach, orientation = _reach(context, rows), np.array([row.orientation for row in rows])
    held_out = np.array([row.set == "test" for row in rows])
    fit = ~held_out
    try:
        found = tool_by_touches(flanges[fit], reach[fit], orientation[fit], taught, touch_sigma_mm(robot))
    except ValueError as error:
        raise _unsolved(context, error, "touch with more, and more different, tool orientations") from error
    centre = sphere_centre(tips(flanges[fit], taught), reach[fit])
    errors = ToolErrorsRow(
        orientation=tuple(orientation.tolist()),
        held_out=tuple(held_out.tolist()),
        taught=tuple(touch_residuals(flanges, reach, taught, centre).tolist()),
        found=tuple(touch_residuals(flanges, reach, found.tool, found.point).tolist()),
    )
    judged = len(np.unique(orientation[held_out]))
    count = min(int(held_out.sum()), _NUMBERS_PER_ORIENTATION * judged)
    return _solution(robot, found, errors, count, f"{judged} orientations not used to find the tool", context.run_name)


def tool_of_poses(context: StepContext) -> Solution:
    """The tool from all poses; each pose is judged by tool and point from the others. Raises InputError."""
    robot, rows = RobotFile.load(context.robot_file), context.recorded(ToolPoseRow)
    flanges, taught = _flanges(robot, [row.joints for row in rows]), np.array(robot.tool.xyz)
    sigma = touch_sigma_mm(robot)
    try:
        found = tool_at_point(flanges, sigma)
        left_out = [tool_at_point(np.delete(flanges, each, axis=0), sigma) for each in range(len(rows))]
    except ValueError as error:
        raise _unsolved(context, error, "five poses at least, with the tool turned about two axes") from error
    at = tips(flanges, taught)
    others = [np.delete(at, each, axis=0).mean(axis=0) for each in range(len(rows))]
    errors = ToolErrorsRow(
        orientation=tuple(range(len(rows))),
        held_out=(True,) * len(rows),
        taught=tuple(np.linalg.norm(at - others, axis=1).tolist()),
        found=tuple(
            float(np.linalg.norm(tips(flanges[each : each + 1], by.tool)[0] - by.point))
            for each, by in enumerate(left_out)
        ),
    )
    return _solution(robot, found, errors, len(rows), "each pose by the others", context.run_name)


def _flanges(robot: RobotFile, joints: Sequence[Sequence[float]]) -> Floats:
    return robot.chain().forward_flange(robot.joint_map().model(np.array(joints)))


def _reach(context: StepContext, rows: Sequence[ToolTouchRow]) -> Floats:
    artefact = artefact_of(context.cell, ("artefact",))
    diameters = {sphere.id: sphere.diameter for sphere in artefact.spheres}
    return np.array([diameters[row.sphere] / 2.0 + artefact.tip_radius for row in rows])


def _unsolved(context: StepContext, error: ValueError, cure: str) -> InputError:
    return InputError(Problem(str(context.run_folder), 0, 0, f"no tool was found: {error}", cure))


def _solution(
    robot: RobotFile, found: FoundTool, errors: ToolErrorsRow, count: int, judged_on: str, run: str
) -> Solution:
    held_out = np.array(errors.held_out)
    pair = [np.abs(np.array(column))[held_out] for column in (errors.taught, errors.found)]
    verdict = paired_verdict(*pair, count=count)
    taught, sigma = np.array(robot.tool.xyz), found.sigma
    figures = ToolFigures(
        taught=tuple(taught.tolist()),
        found=tuple(found.tool.tolist()),
        difference=tuple((found.tool - taught).tolist()),
        sigma=tuple(sigma.tolist()),
        point=tuple(found.point.tolist()),
        orientations=len(set(np.array(errors.orientation)[~held_out].tolist())) or len(errors.orientation),
        contacts=len(found.residuals),
        scatter_mm=found.sigma_mm,
        common_mm=found.common_mm,
    )
    before, after = (ErrorFigures.of(each) for each in pair)
    compared = compared_errors(("with the taught tool", "with the found tool"), (before, after), len(pair[0]))
    return Solution(
        text=tool_text(robot, figures, verdict, run),
        errors=errors,
        verdict=ToolVerdict(
            verdict=verdict,
            sentence=f"Error of held-out contacts ({judged_on}): {compared}. {_ENDS[verdict]}",
            before=Figures(**asdict(before)),
            after=Figures(**asdict(after)),
            lines=tuple(_lines(figures)),
            tool=figures,
        ),
    )


_ENDS: dict[Verdict, str] = {
    "better": "Better than the taught tool.",
    "no better": "No better than the taught tool: the difference is within its own scatter.",
    "worse": "Worse than the taught tool: keep the taught one.",
}


def _lines(figures: ToolFigures) -> list[str]:
    words = ", ".join(
        f"{name} {value:.3f} ± {sigma:.3f}"
        for name, value, sigma in zip("xyz", figures.found, figures.sigma, strict=True)
    )
    apart = float(np.linalg.norm(figures.difference))
    lines = [
        f"Tool found: {words} mm (1 σ), {apart:.3f} mm from the taught one. Nothing was changed on the controller."
    ]
    if figures.common_mm is not None and figures.common_mm > figures.scatter_mm:
        lines.append(
            f"The robot's model errs by {figures.common_mm:.3f} mm per axis (1 σ) from one tool orientation to the "
            f"next, and a contact scatters by {figures.scatter_mm:.3f} mm: a calibrated model finds the tool better."
        )
    return lines


def tool_text(robot: RobotFile, figures: ToolFigures, verdict: Verdict, run: str) -> str:
    """The `tool:` line for the robot file: the found offset, with orientation and mass as taught."""
    xyz, sigma = (", ".join(plain_number(value, 3) for value in each) for each in (figures.found, figures.sigma))
    abc = ", ".join(plain_number(value, 6) for value in robot.tool.abc)
    mass = f", mass: {plain_number(robot.tool.mass, 6)}" if robot.tool.mass else ""
    replace = "Replace the line `tool:` of the robot file by this one."
    use = replace if verdict == "better" else "Not for use: it is not better than the line `tool:` of the robot file."
    return (
        f"# {robot.name}: tool found by run {run} from {figures.contacts} contacts in {figures.orientations} tool "
        f"orientations.\n# 1 σ of xyz: [{sigma}] mm. {_ENDS[verdict]} abc and mass: as taught.\n"
        f"# {use} Nothing was changed on the controller.\n"
        f"tool: {{xyz: [{xyz}], abc: [{abc}]{mass}}}\n"
    )
