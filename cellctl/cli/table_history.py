"""`cellctl table history`: every table that was put in force, by whom, when and from which run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments
from cellctl.cli.table_options import Runs, State

if TYPE_CHECKING:
    from cellctl.operations.table_history import Entry, TableHistory

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
    from cellctl.cli.ends import Exit
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.operations.table_history import TableHistory, histories

    refuse_outputs({"--json": json_}, [cell, state])
    reported = _reported(cell, serial, seed, state) if cell else None
    wanted = reported["serial"] if reported else serial
    known = histories(runs)
    shown = [_one(each, reported, quiet=json_ == "-") for each in ([TableHistory(runs, wanted)] if wanted else known)]
    if not known:
        typer.echo(f"No table is recorded in {runs}: `cellctl table push` and campaigns record theirs.", err=True)
    elif wanted not in (None, *(each.serial for each in known)):
        typer.echo(f"Recorded in {runs}: controllers {', '.join(each.serial for each in known)}.", err=True)
    write_json({"runs": str(runs), "controllers": shown}, json_)
    if any(each["difference"] for each in shown):
        raise typer.Exit(Exit.NOT_BETTER)


def _reported(cell: Path, serial: str | None, seed: int | None, state: Path | None) -> dict[str, Any]:
    """The serial and the tables that the cell's controller reports. Raises InputError if it is not `serial`."""
    from cellctl.files import InputError, Problem
    from cellctl.operations.table import TableCell

    async def work(store: Any, identity: Any) -> dict[str, Any]:
        return {"serial": identity.serial, "state": await store.table_state()}

    place = TableCell.load(cell, seed, state)
    found = place.carry_out(work)
    if place.cell.simulated and state is None:
        typer.echo("cellctl: a simulated controller starts without tables: --state FILE is its memory", err=True)
    if serial not in (None, found["serial"]):
        what = f"is not the serial of this cell's controller, '{found['serial']}'"
        raise InputError(Problem(f"--serial {serial}", 0, 0, what, "leave out --serial or --cell"))
    return found


def _one(history: TableHistory, reported: dict[str, Any] | None, *, quiet: bool) -> dict[str, Any]:
    """Show the history of one controller; its JSON."""
    from cellctl.operations.table import state_of
    from cellctl.operations.table_history import difference_from_controller

    entries, problems = history.read()
    difference = difference_from_controller(entries, reported["state"]) if reported else ""
    for problem in problems:
        typer.echo(f"cellctl: {problem}", err=True)
    if not quiet:
        _show(history, entries)
        if reported:
            typer.echo(_compared(difference))
    return {
        "serial": history.serial,
        "changes": [entry.to_json() for entry in reversed(entries)],
        "unreadable": [f"{problem.file}:{problem.line}" for problem in problems],
        "controller": state_of(reported["state"]) if reported else None,
        "difference": difference or None,
    }


def _compared(difference: str) -> str:
    if not difference:
        return "The controller reports the tables of this record."
    cure = "look with `cellctl table show --cell CELL`; `rollback --to ID` puts a recorded table in force"
    return (
        f"Not as recorded: {difference}. Something else changed it, or another folder of runs has the record.\n{cure}"
    )


def _show(history: TableHistory, entries: list[Entry]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

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
    from cellctl.operations.table_history import short

    begin, facts = entry.begin, entry.begin.facts
    by = f"run {begin.run}, {begin.who}" if begin.run else begin.who
    made = f"{facts.method}, run {facts.run or '–'}, model {facts.model_sha256[:12]}" if facts else "–"
    rows = f"{facts.rows}, ≤ {facts.max_correction_deg:.3f}°" if facts else "–"
    why = entry.why_out if entry.state == "out of force" else entry.reason if entry.result != "in force" else ""
    state = f"{entry.state}: {why}" if why else entry.state
    replaced = f" of {short(begin.replaced)}" if begin.replaced and begin.action == "withdrawal" else ""
    return [begin.time, entry.until or "–", short(begin.table), f"{begin.action}{replaced}, {by}", rows, made, state]
