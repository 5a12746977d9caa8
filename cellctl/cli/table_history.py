"""`cellctl table history` and `diff`: the tables that were in force, two tables row by row; options of the verbs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, final

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.cli.exit_codes import Exit
from cellctl.devices import ControllerTable, Identity, TableState, TableStore
from cellctl.files import InputError, Problem
from cellctl.formats import RobotFile
from cellctl.operations.results import as_json
from cellctl.operations.table import TableCell, TableRecorder, controller_table, differences
from cellctl.operations.table_diff import ComparedTable, TableDifference, table_difference
from cellctl.operations.table_history import (
    Entry,
    TableHistory,
    difference_from_controller,
    histories,
    short,
    table_named,
)

State = Annotated[Path | None, typer.Option(help="File that keeps a simulated cell's state between calls.")]
Runs = Annotated[Path, typer.Option("--runs", help="Folder of the runs; the history of tables is in it.")]


@contextmanager
def recorded(runs: Path, serial: str) -> Iterator[TableRecorder]:
    """Records changes of controller `serial`; a history that cannot be written is reported on stderr."""
    recorder = TableRecorder(TableHistory(runs, serial))
    try:
        yield recorder
    finally:
        if recorder.failure:
            typer.echo(f"cellctl: {recorder.failure}", err=True)


def show_result(json_: str | None, result: dict[str, Any], words: str) -> None:
    """The words on stdout, the JSON where it is asked for."""
    if json_ != "-" and words:  # first: the table is active even if writing the file fails
        typer.echo(words)
    write_json(result, json_)


_WIDTH = 150
_COLUMNS = ("since", "until", "table", "change, by whom", "rows, correction", "made by", "state")


def history(
    cell: arguments.ComparedCell = None,
    serial: Annotated[str | None, typer.Option(help="Serial of a controller. Default: all.")] = None,
    runs: Runs = Path("runs"),
    seed: arguments.Seed = None,
    state: State = None,
    json_: arguments.Json = None,
) -> None:
    """List the tables that were put in force on a controller, newest first.

    With --cell the controller is asked as well: exit code 1 if it has other tables than the record says.

    Example: cellctl table history --serial 925185
    """
    refuse_outputs({"--json": json_}, [cell, state])
    reported = _reported(cell, serial, seed, state) if cell else None
    wanted = reported.serial if reported else serial
    known = histories(runs)
    shown = [_one(each, reported, quiet=json_ == "-") for each in ([TableHistory(runs, wanted)] if wanted else known)]
    if not known:
        typer.echo(f"No table is recorded in {runs}: `cellctl table push` and campaigns record theirs.", err=True)
    elif wanted not in (None, *(each.serial for each in known)):
        typer.echo(f"Recorded in {runs}: controllers {', '.join(each.serial for each in known)}.", err=True)
    write_json({"runs": str(runs), "controllers": shown}, json_)
    if any(each["difference"] for each in shown):
        raise typer.Exit(Exit.NOT_BETTER)


@final
@dataclass(frozen=True, slots=True)
class _Reported:
    """The tables that a controller reports."""

    serial: str
    state: TableState


def _reported(cell: Path, serial: str | None, seed: int | None, state: Path | None) -> _Reported:
    """What the cell's controller reports. Raises InputError if its serial is not `serial`."""

    async def work(store: TableStore, identity: Identity) -> _Reported:
        return _Reported(identity.serial, await store.table_state())

    place = TableCell.load(cell, seed, state)
    found = place.carry_out(work)
    if place.cell.simulated and state is None:
        typer.echo("cellctl: a simulated controller starts without tables: --state FILE is its memory", err=True)
    if serial not in (None, found.serial):
        what = f"is not the serial of this cell's controller, '{found.serial}'"
        raise InputError(Problem(f"--serial {serial}", 0, 0, what, "leave out --serial or --cell"))
    return found


def _one(history: TableHistory, reported: _Reported | None, *, quiet: bool) -> dict[str, Any]:
    """Show the history of one controller; its JSON."""
    entries, problems = history.read()
    difference = difference_from_controller(entries, reported.state) if reported else ""
    for problem in problems:
        typer.echo(f"cellctl: {problem}", err=True)
    if not quiet:
        _show(history, entries)
        if reported:
            typer.echo(_compared_with_controller(difference))
    return {
        "serial": history.serial,
        "changes": [as_json(entry.shown) for entry in reversed(entries)],
        "unreadable": [f"{problem.file}:{problem.line}" for problem in problems],
        "controller": as_json(reported.state) if reported else None,
        "difference": difference or None,
    }


def _compared_with_controller(difference: str) -> str:
    if not difference:
        return "The controller reports the tables of this record."
    cure = "look with `cellctl table show --cell CELL`; `rollback --to ID` puts a recorded table in force"
    return (
        f"Not as recorded: {difference}. Something else changed it, or another folder of runs has the record.\n{cure}"
    )


def _show(history: TableHistory, entries: list[Entry]) -> None:
    from rich.console import Console  # only for people: 0.1 s
    from rich.markup import escape  # only for people: 0.1 s
    from rich.table import Table  # only for people: 0.1 s

    typer.echo(f"Controller {history.serial}:{'' if entries else ' no table is recorded'}")
    if not entries:
        return
    console = Console(highlight=False)
    console.width = max(console.width, _WIDTH)
    table = Table(box=None, pad_edge=False)
    for title in _COLUMNS:
        table.add_column(
            title, overflow="fold", no_wrap=title in _COLUMNS[:3], justify="right" if title == _COLUMNS[4] else "left"
        )
    for entry in reversed(entries):
        style = {"in force": "green", "uncertain": "red"}.get(entry.state, "")
        table.add_row(*map(escape, _cells(entry)), style=style)
    console.print(table)


def _cells(entry: Entry) -> list[str]:
    begin, facts = entry.begin, entry.begin.facts
    by = f"run {begin.run}, {begin.who}" if begin.run else begin.who
    made = f"{facts.method}, run {facts.run or '–'}, model {facts.model_sha256[:12]}" if facts else "–"
    rows = f"{facts.rows}, ≤ {facts.max_correction_deg:.3f}°" if facts else "–"
    why = entry.why_out if entry.state == "out of force" else entry.reason if entry.result != "in force" else ""
    state = f"{entry.state}: {why}" if why else entry.state
    replaced = f" of {short(begin.replaced)}" if begin.replaced and begin.action == "withdrawal" else ""
    return [begin.time, entry.until or "–", short(begin.table), f"{begin.action}{replaced}, {by}", rows, made, state]


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
    refuse_outputs({"--json": json_}, [a, b, cell, robot, state])
    _refuse_active(a, b, cell)
    place = TableCell.load(cell, seed, state) if cell else None
    file = RobotFile.load(robot) if robot else place.robot if place else None
    found = table_difference(_compared_table(a, place, runs), _compared_table(b, place, runs), file)
    show_result(json_, as_json(found), "\n".join(_words(found)))
    if not found.same:
        raise typer.Exit(Exit.NOT_BETTER)


def _refuse_active(a: Path, b: Path, cell: Path | None) -> None:
    if cell is None and _ACTIVE in (str(a), str(b)):
        raise InputError(Problem(_ACTIVE, 0, 0, "is the table in force on a controller", "give --cell CELL"))


def _compared_table(name: Path, place: TableCell | None, runs: Path) -> ComparedTable:
    if place and str(name) == _ACTIVE:
        return _active(place, runs)
    return ComparedTable.of_file(str(name), table_named(name, runs))


def _active(place: TableCell, runs: Path) -> ComparedTable:
    """The table in force: with its file's facts if the history has it and the controller has the same rows."""

    async def work(store: TableStore, identity: Identity) -> tuple[str, ControllerTable | None]:
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
    lines += [f"  {name:13} {_value(pair.a)} → {_value(pair.b)}" for name, pair in found.facts.items()]
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
