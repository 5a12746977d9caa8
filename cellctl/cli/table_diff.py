"""`cellctl table diff`: compares two tables, row by row."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments
from cellctl.cli.table_options import Runs, State, show_result

if TYPE_CHECKING:
    from cellctl.operations.table import TableCell
    from cellctl.operations.table_diff import ComparedTable, TableDifference

_ACTIVE = "active"
_SHOWN = 20
_Name = Annotated[
    Path, typer.Argument(help="Table file, id (or its beginning) of a table in the history, or `active` with --cell.")
]


def diff(
    a: _Name,
    b: _Name,
    cell: arguments.ComparedCell = None,
    robot: arguments.TcpRobot = None,
    runs: Runs = Path("runs"),
    seed: arguments.Seed = None,
    state: State = None,
    json_: arguments.Json = None,
) -> None:
    """Compare two tables: robot, tool, model, and the joints row by row.

    Rows belong together by their targets, or for `active`, if its file is unknown, by their nominal joints. Exit code
    0: the same; 1: different.

    Example: cellctl table diff 9856401189b3 table.json --robot kr5_r1400
    """
    from cellctl.cli.ends import Exit
    from cellctl.cli.outputs import refuse_outputs
    from cellctl.formats import RobotFile
    from cellctl.operations.table import TableCell
    from cellctl.operations.table_diff import table_difference

    refuse_outputs({"--json": json_}, [a, b, cell, robot, state])
    _refuse_active(a, b, cell)
    place = TableCell.load(cell, seed, state) if cell else None
    file = RobotFile.load(robot) if robot else place.robot if place else None
    found = table_difference(_compared(a, place, runs), _compared(b, place, runs), file)
    show_result(json_, found.to_json(), "\n".join(_words(found)))
    if not found.same:
        raise typer.Exit(Exit.NOT_BETTER)


def _refuse_active(a: Path, b: Path, cell: Path | None) -> None:
    from cellctl.files import InputError, Problem

    if cell is None and _ACTIVE in (str(a), str(b)):
        raise InputError(Problem(_ACTIVE, 0, 0, "is the table in force on a controller", "give --cell CELL"))


def _compared(name: Path, place: TableCell | None, runs: Path) -> ComparedTable:
    from cellctl.operations.table_diff import ComparedTable
    from cellctl.operations.table_history import table_named

    if place and str(name) == _ACTIVE:
        return _active(place, runs)
    return ComparedTable.of_file(str(name), table_named(name, runs))


def _active(place: TableCell, runs: Path) -> ComparedTable:
    """The table in force: with its file's facts if the history has it and the controller has the same rows."""
    from cellctl.files import InputError, Problem
    from cellctl.operations.table import controller_table, differences
    from cellctl.operations.table_diff import ComparedTable
    from cellctl.operations.table_history import TableHistory

    async def work(store: Any, identity: Any) -> Any:
        return identity.serial, await store.read_table()

    serial, found = place.carry_out(work)
    if found is None:
        cure = "push one, or compare with an id of `cellctl table history`"
        raise InputError(Problem(_ACTIVE, 0, 0, f"no table is in force on controller '{serial}'", cure))
    try:
        file = TableHistory(runs, serial).table(found.id)
    except InputError:
        return ComparedTable.of_controller(_ACTIVE, found)
    if differences(controller_table(file), serial, found):
        return ComparedTable.of_controller(_ACTIVE, found)
    return ComparedTable.of_file(_ACTIVE, file)


def _words(found: TableDifference) -> list[str]:
    names = " and ".join(f"{one.name} ({one.id[:12]})" if one.name != one.id else one.id for one in (found.a, found.b))
    if found.same:
        return [f"{names} are the same: {found.matched} rows."]
    lines = [f"{names} differ."]
    lines += [f"  {name:13} {_value(pair[0])} → {_value(pair[1])}" for name, pair in found.facts.items()]
    return [*lines, *_changes(found), *_only(found)]


def _changes(found: TableDifference) -> list[str]:
    lines = [f"  {found.matched} rows are in both, {len(found.changed)} of them with other joints"]
    if not found.changed:
        return lines
    most = max(found.changed, key=lambda row: row.change_deg)
    lines[0] += f": by up to {most.change_deg:.4f}° (A{most.joint})"
    lines[0] += f", the nominal TCP by up to {found.max_tcp_mm:.3f} mm" if found.max_tcp_mm is not None else ""
    for row in sorted(found.changed, key=lambda row: -row.change_deg)[:_SHOWN]:
        number = f"{row.row_a}" if row.row_a == row.row_b else f"{row.row_a} → {row.row_b}"
        tcp = "" if row.tcp_mm is None else f", TCP {row.tcp_mm:.3f} mm"
        nominal = f", nominal joints by {row.nominal_deg:.4f}°" if row.nominal_deg else ""
        lines.append(f"    row {number}: A{row.joint} by {row.change_deg:.4f}°{tcp}{nominal}")
    if len(found.changed) > _SHOWN:
        lines.append(f"    and {len(found.changed) - _SHOWN} rows with smaller changes: --json has all")
    return lines


def _only(found: TableDifference) -> list[str]:
    pairs = ((found.a.name, found.only_a), (found.b.name, found.only_b))
    return [f"  only in {name}: {_numbers(rows)}" for name, rows in pairs if rows]


def _numbers(rows: list[int]) -> str:
    more = f" and {len(rows) - _SHOWN} more" if len(rows) > _SHOWN else ""
    return f"row{'s' * (len(rows) > 1)} {', '.join(map(str, rows[:_SHOWN]))}{more}"


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return " ".join(f"{key} {part}" for key, part in value.items())
    return f"{value[:12]}" if isinstance(value, str) and len(value) == 64 else str(value)
