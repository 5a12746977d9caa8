"""`cellctl table`: a compensation table into a controller's force, looked at, compared, and out again."""

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

app = typer.Typer(no_args_is_help=True, help="The controller's compensation table: push, show, verify, rollback.")

_Table = Annotated[Path, typer.Argument(help="Table file, as `cellctl compensate` or a run writes it.")]
_State = Annotated[Path | None, typer.Option(help="A simulated cell's memory: a file that it reads and writes.")]


@app.command()
def push(
    table: _Table,
    cell: arguments.CellOption,
    seed: arguments.Seed = None,
    state: _State = None,
    json_: arguments.Json = None,
) -> None:
    """Put a table into force: refuse what is not for this robot, stage, read back, compare, activate at once.

    The table before stays in force until the very end, and can be had back with rollback.

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
    """Show a table file, or what tables a cell's controller has (in force, the one before, a staged one).

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
    """Is this very table in force? Reads every row from the controller and compares it with the file, digit by digit.

    Ends with 0 where it is, 1 where it is not.

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
    """Put the table before into force again (or none, where there was none); a second rollback undoes it.

    Example: cellctl table rollback --cell sphere_cell
    """
    from cellctl.cli.table_words import state_words
    from cellctl.operations.table_cell import TableCell, state_of

    refuse_outputs({"--json": json_}, [cell, state])

    async def work(store: TableStore, identity: Any) -> dict[str, Any]:
        return {"serial": identity.serial, **state_of(await store.rollback_table())}

    result = _on(TableCell.load(cell, seed, state), work)
    _show(json_, result, state_words(result))


def _on(place: TableCell, work: Callable[[TableStore, Any], Awaitable[Result]]) -> Result:
    """What `work` makes of the cell's table store and its identity, once that is connected."""
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

    if json_ != "-":  # first of all: whatever becomes of the file, the table is in force
        typer.echo(words)
    write_json(result, json_)
