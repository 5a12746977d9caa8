"""`cellctl table`: pushes, shows, verifies and rolls back a controller's compensation table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_json_on_stdout, refuse_outputs, to_stdout
from cellctl.cli.exit_codes import Exit, adding
from cellctl.cli.table_history import Runs, State, diff, history, recorded, show_result
from cellctl.devices import Identity, TableState, TableStore
from cellctl.files import InputError, Problem, write_atomically
from cellctl.formats import TableFile
from cellctl.formats.table import JOINT_DECIMALS
from cellctl.formats.table_export import krl_module, module_name, nominal_name, targets_csv
from cellctl.formats.table_making import table_figures
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


def state_words(serial: str, state: TableState | RolledBack) -> str:
    """The tables of controller `serial`, one line each."""
    lines = [f"Controller {serial}:"]
    for info, words in ((state.active, "in force"), (state.previous, "before it"), (state.staged, "staged")):
        lines.append(f"  {words:9}  " + (f"{info.id[:12]}, {info.rows} rows" if info else "none"))
    return "\n".join(lines)


def in_force_words(pushed: Pushed) -> str:
    """The result of a push."""
    return f"Table {pushed.id[:12]} is in force on {pushed.serial}: {pushed.rows} rows, read back."


def table_words(table: TableFile) -> str:
    """A table file in a few lines."""
    figures = table_figures(table)
    before, after, sigma = (figures[name] for name in ("predicted_before_mm", "predicted_after_mm", "sigma_mm"))
    kind = "a simulated" if table.simulated else "a real"
    return "\n".join(
        [
            f"Table {table.id}",
            f"  for        {table.robot.name}, {kind} controller, serial {table.robot.serial}",
            f"  made       {table.created}, {table.source.method}, run {table.source.run or '-'}",
            f"  rows       {figures['rows']}, joints corrected by up to {figures['max_correction_deg']:.3f}°",
            f"  predicted  error {before['mean']:.3f} mm with nominal joints, {after['mean']:.4f} with these (mean)",
            f"  joints     with {JOINT_DECIMALS} decimals of a degree, as the controller takes them",
            "  σ          "
            + (f"{sigma['rms']:.3f} mm (RMS), {sigma['max']:.3f} mm (max)" if sigma else "none: of another predictor"),
        ]
    )


_PLACES = """\
{files} in {folder}: table {id}, {rows} rows, for {robot}, serial {serial}.
  Load both   KRC:\\R1\\Program\\ (user group Expert), or KRC/R1/Program of a WorkVisual project.
  Use         {name}(N) after the INI of your program moves point to point to row N; {nominal}(N) to its nominal joints.
  Before      The rows are joints: the tool on the flange must be that of the table.
  First       T1, override 10 %, row by row. Not tried on a real controller.
{simulated}"""

_SIMULATED = "  SIMULATED   The table is of a simulated robot: both routines stop at HALT.\n"


def refuse_export(table: Path, krl: bool, csv: bool, out: Path | None, json_: str | None) -> None:
    """Raise InputError for options that contradict each other, or an output that cannot be written."""
    if krl == csv:
        raise InputError(Problem("cellctl table export", 0, 0, "writes one form", "give --krl or --csv"))
    refuse_outputs({"--json": json_} if krl else {"-o": out, "--json": json_}, [table])
    if csv:
        refuse_json_on_stdout(json_, out, "the CSV")


def export_krl(table: TableFile, folder: Path) -> tuple[dict[str, Any], str]:
    """Write the KRL module to `folder` (CR LF); the result as data and in words. Raises InputError, OSError."""
    if str(folder) == "-" or (folder.exists() and not folder.is_dir()):
        raise InputError(Problem(str(folder), 0, 0, "is no folder", "give -o a folder: the KRL module has two files"))
    made = krl_module(table)
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in made.items():
        write_atomically(folder / name, text.replace("\n", "\r\n"))
    result = {"id": table.id, "folder": str(folder), "files": list(made), "rows": len(table.rows)}
    words = _PLACES.format(
        files=" and ".join(made),
        folder=folder,
        id=table.id[:12],
        rows=len(table.rows),
        robot=table.robot.name,
        serial=table.robot.serial,
        name=module_name(table),
        nominal=nominal_name(table),
        simulated=_SIMULATED if table.simulated else "",
    )
    return result, words.rstrip("\n")


def export_csv(table: TableFile, out: Path | None) -> tuple[dict[str, Any], str]:
    """Write the targets as CSV to `out` or stdout; the result, and words for a file."""
    text = targets_csv(table)
    result = {"id": table.id, "file": str(out) if out else None, "rows": len(table.rows)}
    if out is None:
        to_stdout(text)
        return result, ""
    write_atomically(out, text)
    return result, f"{len(table.rows)} targets of table {table.id[:12]} in {out}: nominal and compensated joints, deg."
