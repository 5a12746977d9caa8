"""`cellctl table`: pushes, shows, compares and rolls back a controller's compensation table."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from cellctl.cli import arguments
from cellctl.cli.ends import Exit, adding
from cellctl.cli.outputs import refuse_outputs

if TYPE_CHECKING:
    from cellctl.devices import TableStore
    from cellctl.operations.table_cell import TableCell

Result = TypeVar("Result")

app = typer.Typer(no_args_is_help=True, help="Push, show, verify or roll back a compensation table.")

_Table = Annotated[Path, typer.Argument(help="Table file, as `cellctl compensate` or a run writes it.")]
_State = Annotated[Path | None, typer.Option(help="File that keeps a simulated cell's state between calls.")]


@app.command()
def push(
    table: _Table,
    cell: arguments.CellOption,
    seed: arguments.Seed = None,
    state: _State = None,
    json_: arguments.Json = None,
) -> None:
    """Send a table to the controller and activate it.

    A table for another robot is refused. The table is staged, read back and compared, then activated in one step. The
    previous table stays active until then; `rollback` restores it.

    Example: cellctl table push table.json --cell sphere_cell
    """
    from cellctl.formats import TableFile
    from cellctl.operations.table_cell import TableCell, push_checked

    refuse_outputs({"--json": json_}, [table, cell, state])
    file = TableFile.load(table)
    place = TableCell.load(cell, seed, state)

    async def work(store: TableStore, identity: Any) -> dict[str, Any]:
        return await push_checked(store, identity, file, table, place)

    with adding("nothing was written"):
        result = _on(place, work)
    if place.cell.simulated and state is None:
        typer.echo("cellctl: the simulated controller has forgotten it again: --state FILE is its memory", err=True)
    _show(json_, result, f"Table {file.id[:12]} is in force on {file.robot.serial}: {len(file.rows)} rows, read back.")


@app.command()
def show(
    table: Annotated[Path | None, typer.Argument(help="Table file.")] = None,
    cell: arguments.ShownCell = None,
    seed: arguments.Seed = None,
    state: _State = None,
    json_: arguments.Json = None,
) -> None:
    """Show a table file, or the tables of a controller.

    With --cell: the active, the previous and the staged table.

    Example: cellctl table show table.json
    """
    from cellctl.cli.table_words import state_words, table_words
    from cellctl.formats import TableFile
    from cellctl.operations.table_cell import TableCell, state_of

    _one_of(table, cell)
    refuse_outputs({"--json": json_}, [table, cell, state])
    if table:
        file = TableFile.load(table)
        _show(json_, file.model_dump(), table_words(file))
        return
    assert cell is not None

    async def work(store: TableStore, identity: Any) -> dict[str, Any]:
        return {"serial": identity.serial, **state_of(await store.table_state())}

    result = _on(TableCell.load(cell, seed, state), work)
    _show(json_, result, state_words(result))


@app.command()
def verify(
    table: _Table,
    cell: arguments.CellOption,
    seed: arguments.Seed = None,
    state: _State = None,
    json_: arguments.Json = None,
) -> None:
    """Compare the active table with a file, digit by digit.

    Reads every row from the controller. Exit code 0: the same; 1: different.

    Example: cellctl table verify table.json --cell sphere_cell
    """
    from cellctl.formats import TableFile
    from cellctl.operations.table import controller_table, differences
    from cellctl.operations.table_cell import TableCell

    refuse_outputs({"--json": json_}, [table, cell, state])
    wanted = controller_table(TableFile.load(table))

    async def work(store: TableStore, identity: Any) -> dict[str, Any]:
        found = differences(wanted, identity.serial, await store.read_table())
        return {
            "id": wanted.id,
            "serial": identity.serial,
            "rows": len(wanted.rows),
            "same": not found,
            "differences": found,
        }

    result = _on(TableCell.load(cell, seed, state), work)
    same = f"Table {wanted.id[:12]} is in force on {result['serial']}, all {result['rows']} rows as in the file."
    _show(json_, result, same if result["same"] else "\n".join(["Not the table in force:", *result["differences"]]))
    if not result["same"]:
        raise typer.Exit(Exit.NOT_BETTER)


@app.command()
def rollback(
    cell: arguments.CellOption, seed: arguments.Seed = None, state: _State = None, json_: arguments.Json = None
) -> None:
    """Activate the previous table (or none) again.

    A second rollback undoes the first.

    Example: cellctl table rollback --cell sphere_cell
    """
    from cellctl.cli.table_words import state_words
    from cellctl.operations.table_cell import TableCell, state_of

    refuse_outputs({"--json": json_}, [cell, state])

    async def work(store: TableStore, identity: Any) -> dict[str, Any]:
        return {"serial": identity.serial, **state_of(await store.rollback_table())}

    result = _on(TableCell.load(cell, seed, state), work)
    _show(json_, result, state_words(result))


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
    from cellctl.cli.table_export import export_csv, export_krl, refuse_export
    from cellctl.formats import TableFile

    refuse_export(table, krl, csv, out, json_)
    file = TableFile.load(table)
    result, words = export_krl(file, out or Path()) if krl else export_csv(file, out)
    _show(json_, result, words)


def _on(place: TableCell, work: Callable[[TableStore, Any], Awaitable[Result]]) -> Result:
    """The result of `work` on the connected table store of the cell and its identity."""
    import asyncio

    async def go() -> Result:
        async with place.connected() as (store, identity):
            return await work(store, identity)

    return asyncio.run(go())


def _one_of(table: Path | None, cell: Path | None) -> None:
    from cellctl.files import InputError, Problem

    if (table is None) == (cell is None):
        raise InputError(Problem("cellctl table show", 0, 0, "shows one thing", "a table file, or --cell CELL"))


def _show(json_: str | None, result: dict[str, Any], words: str) -> None:
    from cellctl.cli.outputs import write_json

    if json_ != "-" and words:  # first: the table is active even if writing the file fails
        typer.echo(words)
    write_json(result, json_)
