"""Returns to one touch: the shift since then, and whether it drifts or has jumped."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cellctl.calibration import Drift, linear_drift
from cellctl.devices import DeviceFault
from cellctl.formats import RobotFile, artefact_of
from cellctl.procedure import StepContext
from procedures.steps.sphere.rows import DriftFigures, LocateRow, ReferenceRow, TouchRow

_JUMP_SIGMAS = 5.0
_JUMP_MM = 0.1
_REMARKED_SIGMAS = 3.0
"""Scatter alone exceeds 3 σ once in 370 visits."""


def touch_sigma_mm(robot: RobotFile) -> float:
    """1 σ of one touch along the normal, mm: the robot's repeatability on one axis."""
    return robot.repeatability / math.sqrt(3.0)


def reference_row(context: StepContext, row: TouchRow, repeats: int) -> ReferenceRow:
    """The record of a return to touch number `repeats`, from the row of that touch."""
    robot = RobotFile.load(context.robot_file)
    first = next(touch for touch in context.recorded(TouchRow) if touch.number == repeats)
    sphere = artefact_of(context.cell, ("artefact",)).sphere(first.sphere)
    assert sphere is not None
    tips = robot.chain().forward(robot.joint_map().model([first.joints, row.joints]))[:, :3, 3]
    normal = tips[0] - np.array(sphere.centre)
    shift = float((tips[1] - tips[0]) @ normal / np.linalg.norm(normal))
    return ReferenceRow(
        **row.data(),
        repeats=repeats,
        after_touch=last_number(context, TouchRow, LocateRow),
        shift_mm=shift,
        sigma_mm=math.sqrt(2.0) * touch_sigma_mm(robot),
    )


def last_number(context: StepContext, *kinds: type[TouchRow]) -> int:
    """The highest number of a touch of these kinds that counts."""
    return max(row.number for kind in kinds for row in context.recorded(kind))


def jump(visits: Sequence[ReferenceRow]) -> DeviceFault | None:
    """The error if the last of `visits` differs from the previous one by more than the scatter."""
    last, change = visits[-1], _change_mm(visits)
    limit = max(_JUMP_SIGMAS * last.sigma_mm, _JUMP_MM)
    if abs(change) <= limit:
        return None
    where = "deeper into" if change < 0.0 else "farther from"
    what = (
        f"back at the reference touch on {last.sphere}, contact came {abs(change):.3f} mm {where} the sphere than "
        f"at the visit before (scatter explains {limit:.3f} mm): the tip or the robot has changed"
    )
    cure = (
        "look at the tip (bent, shortened, spatter on it) and at the sphere's place; after a collision check the "
        "robot's mastering; then begin anew: the touches before and after do not belong together"
    )
    return DeviceFault("tip, robot", what, cure)


def remark(visits: Sequence[ReferenceRow]) -> str | None:
    """What is said of the last of `visits` if it is farther off than scatter explains: from the visit before (a step),
    or else from the first one (a drift, for which no single step is large).
    """
    last = visits[-1]
    for change_mm, where in ((_change_mm(visits), "visit before"), (last.shift_mm, "first visit")):
        sigmas = abs(change_mm) / last.sigma_mm
        if sigmas > _REMARKED_SIGMAS:
            return (
                f"that is {sigmas:.1f} σ from the {where}: scatter alone exceeds 3 σ once in 370 visits; "
                "look at the tip and the sphere if the next return is as far off"
            )
    return None


def _change_mm(visits: Sequence[ReferenceRow]) -> float:
    """Of the shift since the visit before; the first return is compared with the first visit."""
    return visits[-1].shift_mm - (visits[-2].shift_mm if len(visits) > 1 else 0.0)


def drift_of(context: StepContext) -> Drift:
    """The drift through all visits to the reference touch so far, the first among them."""
    visits = context.recorded(ReferenceRow)
    if not visits:
        return linear_drift([], [], 0.0)
    sigma = touch_sigma_mm(RobotFile.load(context.robot_file))
    numbers = [visits[0].repeats, *(row.number for row in visits)]
    return linear_drift(numbers, [0.0, *(row.shift_mm for row in visits)], sigma)


def drift_figures(drift: Drift, touches: int, *, modelled: bool) -> DriftFigures:
    """The drift as the verdict shows it; total_mm: over `touches` touches; modelled: corrected for."""
    return DriftFigures(
        visits=drift.visits,
        mm_per_touch=drift.mm_per_touch,
        sigma_mm_per_touch=drift.sigma,
        t=drift.t,
        significant=drift.significant,
        total_mm=drift.mm_per_touch * touches,
        modelled=modelled,
    )
