"""`cellctl table`: pushes, shows, verifies and rolls back a controller's compensation table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs
from cellctl.cli.exit_codes import Exit, adding
from cellctl.cli.table_history import Runs, State, diff, history, recorded, show_result
from cellctl.cli.table_output import export_csv, export_krl, in_force_words, refuse_export, state_words, table_words
from cellctl.devices import Identity, TableState, TableStore
from cellctl.files import InputError, Problem
from cellctl.formats import TableFile
from cellctl.operations.results import as_json
from cellctl.operations.table import (
    Pushed,
    RolledBack,
    TableCell,
    Verified,
    controller_table,
    push_checked,
    push_recorded,
    rolled_back,
    verified,
)
from cellctl.operations.table_history import table_named

app = typer.Typer(no_args_is_help=True, help="Push, show, verify, compare or roll back a compensation table.")

_Table = Annotated[Path, typer.Argument(help="Table file, as `cellctl compensate` or a run writes it.")]


@app.command()
def push(
    table: _Table,
    cell: arguments.CellOption,
    seed: arguments.Seed = None,
    state: State = None,
    runs: Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Send a table to the controller and activate it.

    A table for another robot is refused. The table is staged, read back and compared, then activated in one step. The
    previous table stays active until then; `rollback` restores it. The change is recorded in the history.

    Example: cellctl table push table.json --cell sphere_cell
    """
    refuse_outputs({"--json": json_}, [table, cell, state])
    file = TableFile.load(table)
    place = TableCell.load(cell, seed, state)

    async def work(store: TableStore, identity: Identity) -> Pushed:
        with recorded(runs, identity.serial) as recorder:
            return await push_checked(store, identity, file, table, place, recorder)

    with adding("nothing was written"):
        result = place.carry_out(work)
    _warn_without_memory(place)
    show_result(json_, as_json(result), in_force_words(result))


@app.command()
def show(
    table: Annotated[
        Path | None, typer.Argument(help="Table file, or the id (or its beginning) of a table in the history.")
    ] = None,
    cell: arguments.ShownCell = None,
    seed: arguments.Seed = None,
    state: State = None,
    runs: Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Show a table file, a table of the history, or the tables of a controller.

    With --cell: the active, the previous and the staged table.

    Example: cellctl table show table.json
    """
    _one_of(table, cell)
    refuse_outputs({"--json": json_}, [table, cell, state])
    if table:
        file = table_named(table, runs)
        show_result(json_, file.model_dump(), table_words(file))
        return
    assert cell is not None

    async def work(store: TableStore, identity: Identity) -> tuple[str, TableState]:
        return identity.serial, await store.table_state()

    serial, found = TableCell.load(cell, seed, state).carry_out(work)
    show_result(json_, {"serial": serial, **as_json(found)}, state_words(serial, found))


@app.command()
def verify(
    table: Annotated[Path, typer.Argument(help="Table file, or the id (or its beginning) of a table in the history.")],
    cell: arguments.CellOption,
    seed: arguments.Seed = None,
    state: State = None,
    runs: Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Compare the active table with a file or a table of the history, digit by digit.

    Reads every row from the controller. Exit code 0: the same; 1: different.

    Example: cellctl table verify table.json --cell sphere_cell
    """
    refuse_outputs({"--json": json_}, [table, cell, state])
    wanted = controller_table(table_named(table, runs))

    async def work(store: TableStore, identity: Identity) -> Verified:
        return await verified(store, identity.serial, wanted)

    result = TableCell.load(cell, seed, state).carry_out(work)
    same = f"Table {wanted.id[:12]} is in force on {result.serial}, all {result.rows} rows as in the file."
    words = same if result.same else "\n".join(["Not the table in force:", *result.differences])
    show_result(json_, as_json(result), words)
    if not result.same:
        raise typer.Exit(Exit.NOT_BETTER)


@app.command()
def rollback(
    cell: arguments.CellOption,
    to: Annotated[str | None, typer.Option(help="Id (or its beginning) of a table in the history.")] = None,
    seed: arguments.Seed = None,
    state: State = None,
    runs: Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Activate the previous table (or none) again, or any table of the history.

    A second rollback undoes the first. With --to the copy of that table in the history is pushed, after the same checks
    as by `push`.

    Example: cellctl table rollback --cell sphere_cell --to 9856401189b3
    """
    refuse_outputs({"--json": json_}, [cell, state])
    place = TableCell.load(cell, seed, state)

    async def work(store: TableStore, identity: Identity) -> Pushed | RolledBack:
        with recorded(runs, identity.serial) as recorder:
            if to is not None:
                return await push_recorded(store, identity, to, place, recorder)
            return await rolled_back(store, identity.serial, await store.table_state(), recorder)

    with adding("nothing was written"):
        result = place.carry_out(work)
    _warn_without_memory(place)
    words = in_force_words(result) if isinstance(result, Pushed) else state_words(result.serial, result)
    show_result(json_, as_json(result), words)


@app.command()
def export(
    table: _Table,
    krl: Annotated[bool, typer.Option("--krl", help="A KRL module: .dat and .src, to load by hand.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="CSV: targets, joints, predicted errors.")] = False,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder for --krl (default: this one), file for --csv.")
    ] = None,
    json_: arguments.Json = None,
) -> None:
    """Write a table's joints as a KRL module or as CSV.

    A table that was changed after it was made is refused.

    Example: cellctl table export table.json --krl -o krc
    """
    refuse_export(table, krl, csv, out, json_)
    file = TableFile.load(table)
    result, words = export_krl(file, out or Path()) if krl else export_csv(file, out)
    show_result(json_, result, words)


app.command()(history)
app.command()(diff)


def _warn_without_memory(place: TableCell) -> None:
    if place.cell.simulated and place.state is None:
        typer.echo("cellctl: the simulated controller has forgotten it again: --state FILE is its memory", err=True)


def _one_of(table: Path | None, cell: Path | None) -> None:
    if (table is None) == (cell is None):
        raise InputError(Problem("cellctl table show", 0, 0, "shows one thing", "a table file, or --cell CELL"))
