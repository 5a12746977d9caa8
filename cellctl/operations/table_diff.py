"""Difference of two compensation tables: rows matched by their targets or nominal joints, and their changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self, final

import numpy as np

from cellctl.devices import ControllerTable
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile, TableFile
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.kinematics import Floats, pose_from_xyz_abc

_SAME = 1e-6
"""Largest difference of equal targets (mm, deg) or nominal joints (deg)."""


@final
@dataclass(frozen=True, slots=True)
class ComparedTable:
    """A table to compare: its rows, and its file. name: as messages name it.

    nominal, compensated: readings (N, n), deg; targets: (N, 6), mm and deg. file, targets: None for rows that are
    known from the controller alone.
    """

    name: str
    id: str
    serial: str
    nominal: Floats
    compensated: Floats
    targets: Floats | None = None
    file: TableFile | None = None

    @classmethod
    def of_file(cls, name: str, file: TableFile) -> Self:
        """From a table file."""
        nominal, compensated, targets = (
            np.array([getattr(row, part) for row in file.rows]) for part in ("nominal", "compensated", "target")
        )
        return cls(name, file.id, file.robot.serial, nominal, compensated, targets, file)

    @classmethod
    def of_controller(cls, name: str, table: ControllerTable) -> Self:
        """From the rows that a controller reports."""
        nominal, compensated = (
            np.array([getattr(row, part) for row in table.rows]) for part in ("nominal", "compensated")
        )
        return cls(name, table.id, table.serial, nominal, compensated)


@final
@dataclass(frozen=True, slots=True)
class RowChange:
    """A row (numbers from 1) that is in both tables, with other joints.

    joint: the one whose compensated reading changes most, by change_deg; nominal_deg: largest change of a nominal
    reading; tcp_mm: nominal distance of the TCPs at the compensated joints, None without a robot file.
    """

    row_a: int
    row_b: int
    joint: int
    change_deg: float
    nominal_deg: float
    tcp_mm: float | None


@final
@dataclass(frozen=True, slots=True)
class NamedTable:
    """A table as messages name it, and its id."""

    name: str
    id: str


@final
@dataclass(frozen=True, slots=True)
class FactPair:
    """A fact of the tables a and b."""

    a: Any
    b: Any


@final
@dataclass(frozen=True, slots=True)
class TableDifference:
    """Difference of tables a and b. facts: those that differ; matched: number of rows in both.

    max_change_deg, max_tcp_mm: largest change of a compensated reading and of a nominal TCP, None without a robot file;
    only_a, only_b: rows of one table alone, from 1.
    """

    a: NamedTable
    b: NamedTable
    same: bool
    facts: dict[str, FactPair]
    matched: int
    max_change_deg: float
    max_tcp_mm: float | None
    changed: list[RowChange]
    only_a: list[int]
    only_b: list[int]


def table_difference(a: ComparedTable, b: ComparedTable, robot: RobotFile | None) -> TableDifference:
    """Compare two tables. robot: for the nominal TCPs; the tool is the tables' own.

    Raises InputError if a table is for another robot than `robot`.
    """
    if robot:
        _refuse_robot(robot, a, b)
    facts = _facts(a, b)
    if a.nominal.shape[1] != b.nominal.shape[1]:
        return _difference(a, b, facts, [], [])
    pairs = _matched(a, b)
    changed = _changes(a, b, pairs, robot)
    if not facts and not changed and a.id != b.id and len(pairs) == len(a.nominal) == len(b.nominal):
        facts = {"id": FactPair(a.id, b.id)}
    return _difference(a, b, facts, pairs, changed)


def _difference(
    a: ComparedTable,
    b: ComparedTable,
    facts: dict[str, FactPair],
    pairs: list[tuple[int, int]],
    changed: list[RowChange],
) -> TableDifference:
    only_a, only_b = _numbers({row for row, _ in pairs}, a), _numbers({row for _, row in pairs}, b)
    return TableDifference(
        a=NamedTable(a.name, a.id),
        b=NamedTable(b.name, b.id),
        same=not (facts or changed or only_a or only_b),
        facts=facts,
        matched=len(pairs),
        max_change_deg=max((row.change_deg for row in changed), default=0.0),
        max_tcp_mm=max((row.tcp_mm for row in changed if row.tcp_mm is not None), default=None),
        changed=changed,
        only_a=only_a,
        only_b=only_b,
    )


def _refuse_robot(robot: RobotFile, *tables: ComparedTable) -> None:
    problems = []
    for table in tables:
        what = ""
        if table.file and table.file.robot.name != robot.name:
            what = f"is for a '{table.file.robot.name}', the robot file is of a '{robot.name}'"
        elif table.nominal.shape[1] != robot.n:
            what = f"has {table.nominal.shape[1]} joints, the robot file has {robot.n}"
        if what:
            problems.append(Problem(table.name, 0, 0, what, "give the robot file of this table, or leave it out"))
    if problems:
        raise InputError(problems)


def _facts(a: ComparedTable, b: ComparedTable) -> dict[str, FactPair]:
    """Facts that differ; those of a file only where both have one."""
    pairs: dict[str, tuple[Any, Any]] = {"serial": (a.serial, b.serial), "joints": (_joints(a), _joints(b))}
    if a.file and b.file:
        parts = [one.file.model_dump() for one in (a, b) if one.file]
        ours, theirs = ({**part, **part["robot"], **part["source"]} for part in parts)
        names = ("name", "simulated", "tool", "payload", "run", "model_sha256", "method", "joint_region")
        pairs |= {name: (ours[name], theirs[name]) for name in names}
    return {name: FactPair(*pair) for name, pair in pairs.items() if pair[0] != pair[1]}


def _joints(table: ComparedTable) -> int:
    return int(table.nominal.shape[1])


def _numbers(used: set[int], table: ComparedTable) -> list[int]:
    return [row + 1 for row in range(len(table.nominal)) if row not in used]


def _matched(a: ComparedTable, b: ComparedTable) -> list[tuple[int, int]]:
    """Rows of a and b with the same target; of the others (and without targets) those with the same nominal joints.

    Of several rows with the same target the one with the nearest nominal joints is taken, each row once.
    """
    free_a, free_b, pairs = set(range(len(a.nominal))), set(range(len(b.nominal))), list[tuple[int, int]]()
    for ours, theirs in ((a.targets, b.targets), (a.nominal, b.nominal)):
        if ours is None or theirs is None:
            continue
        for row, near in _near(ours, theirs, sorted(free_a)):
            if candidates := sorted(free_b.intersection(near)):
                distances = np.abs(b.nominal[candidates] - a.nominal[row]).max(axis=1)
                chosen = candidates[int(distances.argmin())]
                free_a.remove(row)
                free_b.remove(chosen)
                pairs.append((row, chosen))
    return sorted(pairs)


def _near(ours: Floats, theirs: Floats, rows: list[int]) -> list[tuple[int, list[int]]]:
    """For each of `rows` of `ours` the rows of `theirs` that are the same."""
    from scipy.spatial import cKDTree  # at first use: it takes 0.2 s

    found: Any = cKDTree(theirs).query_ball_point(ours[rows], _SAME, p=np.inf) if rows else []
    return list(zip(rows, found, strict=True))


def _changes(
    a: ComparedTable, b: ComparedTable, pairs: list[tuple[int, int]], robot: RobotFile | None
) -> list[RowChange]:
    if not pairs:
        return []
    rows_a, rows_b = (np.array(rows) for rows in zip(*pairs, strict=True))
    by = np.round(np.abs(b.compensated[rows_b] - a.compensated[rows_a]), JOINT_DECIMALS)
    nominal = np.round(np.abs(b.nominal[rows_b] - a.nominal[rows_a]), JOINT_DECIMALS).max(axis=1)
    tcp = _tcp_distances(a, b, rows_a, rows_b, robot) if robot else None
    return [
        RowChange(
            row_a=int(rows_a[k]) + 1,
            row_b=int(rows_b[k]) + 1,
            joint=int(by[k].argmax()) + 1,
            change_deg=float(by[k].max()),
            nominal_deg=float(nominal[k]),
            tcp_mm=None if tcp is None else float(tcp[k]),
        )
        for k in np.flatnonzero((by.max(axis=1) > 0) | (nominal > 0))
    ]


def _tcp_distances(a: ComparedTable, b: ComparedTable, rows_a: Any, rows_b: Any, robot: RobotFile) -> Floats:
    """Nominal distances (N,), mm, of the TCPs, each table's with its own tool."""
    places = [_tcps(table, table.compensated[rows], robot) for table, rows in ((a, rows_a), (b, rows_b))]
    distances: Floats = np.linalg.norm(places[1] - places[0], axis=1)
    return distances


def _tcps(table: ComparedTable, readings: Floats, robot: RobotFile) -> Floats:
    tool = table.file.tool if table.file else robot.tool
    chain = robot.chain().with_tool(pose_from_xyz_abc(tool.xyz, tool.abc))
    places: Floats = chain.forward(robot.joint_map().model(readings))[:, :3, 3]
    return places
