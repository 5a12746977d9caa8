"""Table files: compensated joints for targets, and why a table must not go to a controller. JSON.

docs/reference/table-files.md explains each field; `table.schema.json` beside this file is its JSON Schema.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from cellctl.files import InputError, Problem, canonical_json, sha256_of, write_atomically
from cellctl.files.validated import content_problems, read_json
from cellctl.kinematics import Floats
from cellctl.robot_file import Number, RobotFile, Tool

_STRICT = ConfigDict(extra="forbid", strict=True, frozen=True)
_Name = Annotated[str, Field(min_length=1)]
_Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
_Joints = Annotated[list[Number], Field(min_length=1, max_length=20)]
_Size = Annotated[float, Field(allow_inf_nan=False, ge=0)]

JOINT_DECIMALS = 6
"""Decimals of a joint reading, deg, as the controller takes it: file and controller hold the same number."""

_CURE = "give a file that `cellctl compensate` or a campaign wrote"


@final
class TableRobot(BaseModel):
    """Whose controller a table is for: its serial, and the robot file's name."""

    model_config = _STRICT
    serial: _Name
    name: _Name


@final
class TableSource(BaseModel):
    """What a table was made from: run (None: no run), SHA-256 of the model file's content, compensation method."""

    model_config = _STRICT
    run: str | None
    model_sha256: _Sha256
    method: _Name


@final
class TableRegion(BaseModel):
    """Least and greatest controller reading of each joint within which a table's model holds, deg."""

    model_config = _STRICT
    min: list[Number]
    max: list[Number]


@final
class Row(BaseModel):
    """One target and its joints.

    target: X, Y, Z, mm, and KUKA angles A, B, C, deg, of the tool centre point in the model's frame. nominal,
    compensated: A1…An, deg. predicted_before_mm, predicted_after_mm: distance of the identified robot's tool centre
    point from the target with these. sigma_mm: 1 σ (3-D) of that prediction; null where another predictor
    of errors than the model states none.
    """

    model_config = _STRICT
    target: Annotated[list[Number], Field(min_length=6, max_length=6)]
    nominal: _Joints
    compensated: _Joints
    predicted_before_mm: _Size
    predicted_after_mm: _Size
    sigma_mm: _Size | None

    @property
    def correction_deg(self) -> float:
        """The joint that is corrected most, deg."""
        return max(abs(after - before) for before, after in zip(self.nominal, self.compensated, strict=True))


@final
class TableFile(BaseModel):
    """A compensation table.

    id: SHA-256 of the content without `id` and `created`. simulated: learnt on a simulator. payload: kg. joint_region:
    readings within which the model holds, deg. created: when, ISO 8601, a label.
    """

    model_config = _STRICT
    format: Literal["cellctl table 1"]
    id: _Sha256
    created: _Name
    robot: TableRobot
    simulated: bool
    tool: Tool
    payload: _Size
    source: TableSource
    joint_region: TableRegion
    rows: Annotated[list[Row], Field(min_length=1)]

    @classmethod
    def of(
        cls,
        rows: list[Row],
        *,
        robot: TableRobot,
        simulated: bool,
        tool: Tool,
        source: TableSource,
        joint_region: TableRegion,
        created: str,
    ) -> Self:
        """A table of `rows`, with its id; the payload is the tool's mass."""
        draft = cls(
            format="cellctl table 1",
            id="0" * 64,
            created=created,
            robot=robot,
            simulated=simulated,
            tool=tool,
            payload=tool.mass,
            source=source,
            joint_region=joint_region,
            rows=rows,
        )
        return draft.model_copy(update={"id": draft.content_id()})

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a table file. Raises InputError where it is none, or where its content does not match its id."""
        content = read_json(path, "table file", _CURE)
        try:
            table = cls.model_validate(content)
            found = _contradictions(table)
        except ValidationError as error:
            raise InputError(content_problems(error, path, "table file", _CURE)) from error
        except (ValueError, RecursionError) as error:
            raise InputError(Problem(str(path), 0, 0, f"is no table file: {error}", _CURE)) from error
        if found:
            raise InputError(Problem(str(path), 0, 0, words, "make the table again") for words in found)
        return table

    def content_id(self) -> str:
        """SHA-256 of the content without `id` and `created`, as canonical JSON."""
        return sha256_of(self.model_dump(exclude={"id", "created"}))

    def text(self) -> str:
        """The file's content: the same table gives the same bytes."""
        return canonical_json(self.model_dump()) + "\n"

    def save(self, path: Path) -> None:
        """Write the file. Raises OSError."""
        write_atomically(path, self.text())

    def pairs(self) -> tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]:
        """Nominal and compensated readings of each row, deg: `TableRow(*pair)` takes each."""
        return tuple((tuple(row.nominal), tuple(row.compensated)) for row in self.rows)

    @property
    def max_correction_deg(self) -> float:
        """The largest correction of a joint in any row, deg."""
        return max(row.correction_deg for row in self.rows)


def table_rows(
    targets: Floats,
    nominal: Floats,
    compensated: Floats,
    before_mm: Floats,
    after_mm: Floats,
    sigma_mm: Floats | None,
    *,
    exact: bool = False,
) -> list[Row]:
    """Rows from arrays: targets (N, 6), readings (N, n), deg, rounded as the controller takes them; mm (N,).

    exact: nothing is rounded.
    """

    def listed(column: Floats, decimals: int = 9) -> list[Any]:
        values: list[Any] = (column if exact else np.round(column, decimals) + 0.0).tolist()  # + 0.0: no minus zero
        return values

    names = ("target", "nominal", "compensated", "predicted_before_mm", "predicted_after_mm", "sigma_mm")
    columns = (
        listed(targets),
        listed(nominal, JOINT_DECIMALS),
        listed(compensated, JOINT_DECIMALS),
        listed(before_mm),
        listed(after_mm),
        [None] * len(targets) if sigma_mm is None else listed(sigma_mm),
    )
    return [Row(**dict(zip(names, values, strict=True))) for values in zip(*columns, strict=True)]


def _contradictions(table: TableFile) -> list[str]:
    """Contradictions between the parts of a table file."""
    found = []
    if table.id != table.content_id():
        found.append(f"was changed after it was made: its content is not that of table {table.id[:12]}…")
    count = len(table.joint_region.min)
    for number, row in enumerate(table.rows, 1):
        if {len(row.nominal), len(row.compensated), len(table.joint_region.max)} != {count}:
            found.append(f"row {number}: not {count} joints everywhere")
    return found


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
