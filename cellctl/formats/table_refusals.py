"""Why a table must not go to a controller: one line for each reason, with the rows."""

from __future__ import annotations

import math

from cellctl.formats.robot import RobotFile, Tool
from cellctl.formats.table import Row, TableFile, TableRegion

_SAME = 1e-6
"""Largest difference of equal lengths, angles or masses in two files, mm, deg, kg."""


def table_problems(
    table: TableFile, *, serial: str, simulated: bool, robot: RobotFile, correction_deg: float
) -> list[str]:
    """Every reason why `table` is not for this controller; empty where it may be pushed.

    serial, simulated: the controller's, as it reports. robot: the cell's robot file (name, tool, joint limits).
    correction_deg: the largest correction of a joint allowed in this cell, deg.
    """
    return [
        *_another_controller(table, serial, simulated),
        *_another_robot(table, robot),
        *_rows(table, robot, correction_deg),
    ]


def _another_controller(table: TableFile, serial: str, simulated: bool) -> list[str]:
    found = []
    if table.simulated and not simulated:
        found.append("it was learnt on a simulator, and this controller is a real one")
    if simulated and not table.simulated:
        found.append("it was learnt on a real robot, and this controller is a simulator")
    if table.robot.serial != serial:
        found.append(f"it is for controller '{table.robot.serial}', this one is '{serial}'")
    return found


def _another_robot(table: TableFile, robot: RobotFile) -> list[str]:
    found = other_robot(table.robot.name, table.tool, robot)
    if abs(table.payload - robot.tool.mass) > _SAME:
        found.append(f"it is for a payload of {table.payload:g} kg, the cell's is {robot.tool.mass:g} kg")
    return found


def other_robot(name: str, tool: Tool, robot: RobotFile) -> list[str]:
    """Why a model or table of robot `name` with `tool` is not for the cell's robot file `robot`; empty where it is."""
    found = []
    if name != robot.name:
        found.append(f"it is for a '{name}', the cell's robot file says '{robot.name}'")
    ours, theirs = ([*each.xyz, *each.abc, each.mass] for each in (robot.tool, tool))
    if any(abs(mine - other) > _SAME for mine, other in zip(ours, theirs, strict=True)):
        found.append(f"it is for the tool {_tool(theirs)}, the cell's is {_tool(ours)}")
    return found


def _tool(numbers: list[float]) -> str:
    xyz, abc = (", ".join(f"{value:g}" for value in part) for part in (numbers[:3], numbers[3:6]))
    return f"({xyz}) mm, ({abc})°, {numbers[6]:g} kg"


def row_problems(
    rows: list[Row], joint_region: TableRegion, robot: RobotFile, correction_deg: float = math.inf
) -> list[list[str]]:
    """For each row the errors of its joints: limits of `robot`, the model's region, corrections, deg."""
    limits = [(joint.min, joint.max) for joint in robot.joints]
    region = list(zip(joint_region.min, joint_region.max, strict=True))
    return [_row(row, limits, region, correction_deg) for row in rows]


def _rows(table: TableFile, robot: RobotFile, correction_deg: float) -> list[str]:
    if len(table.joint_region.min) != robot.n:
        return [f"its rows have {len(table.joint_region.min)} joints, the cell's robot has {robot.n}"]
    problems = row_problems(table.rows, table.joint_region, robot, correction_deg)
    return [f"row {number}: {what}" for number, reasons in enumerate(problems, 1) for what in reasons]


def _row(
    row: Row, limits: list[tuple[float, float]], region: list[tuple[float, float]], correction_deg: float
) -> list[str]:
    found = []
    for kind, joints in (("nominal", row.nominal), ("compensated", row.compensated)):
        beyond = _outside(joints, limits)
        found += [f"{kind} {what}, outside the joint's limits" for what in beyond]
        if not beyond:
            found += [f"{kind} {what}, outside the measured region" for what in _outside(joints, region)]
    for axis, (before, after) in enumerate(zip(row.nominal, row.compensated, strict=True), 1):
        if abs(after - before) > correction_deg:
            found.append(f"A{axis} is corrected by {after - before:+.3f}°, the cell allows {correction_deg:g}°")
    return found


def _outside(joints: list[float], box: list[tuple[float, float]]) -> list[str]:
    slack = 1e-6  # the file's last decimal
    return [
        f"A{axis} {value:.3f}° is not within {low:g}…{high:g}°"
        for axis, (value, (low, high)) in enumerate(zip(joints, box, strict=True), 1)
        if not low - slack <= value <= high + slack
    ]
