"""`cellctl runs` and `cellctl index`: the list of runs, by their index, and the index itself."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.files import InputError, Problem
from cellctl.installed import first_procedure
from cellctl.operations.results import as_json
from cellctl.operations.run_indexing import (
    IndexCheck,
    current_index,
    names_text,
    rebuild_index,
    summary_of,
    verify_index,
)
from cellctl.run_index import FoundRun, IndexUnusable, RunFilter

_COLUMNS = ("run", "began", "state", "points", "verdict", "acceptance", "table")
_KEYS = ("run", "began", "state", "points", "verdict", "acceptance", "table_state")


def runs(
    search: Annotated[
        str,
        typer.Option(help="List only runs with all these words in name, files, operator, devices or verdict."),
    ] = "",
    state: Annotated[str, typer.Option(help="List only runs in this state.")] = "",
    verdict: Annotated[str, typer.Option(help="List only runs with this verdict.")] = "",
    serial: Annotated[str, typer.Option(help="List only runs of the robot with this serial.")] = "",
    procedure: Annotated[str, typer.Option(help="List only runs of this procedure, by its name.")] = "",
    since: Annotated[str, typer.Option(help="List only runs from this day on: 2026-11-21.")] = "",
    until: Annotated[str, typer.Option(help="List only runs up to this day, inclusive: 2026-11-30.")] = "",
    all_hosts: Annotated[
        bool, typer.Option("--all-hosts", help="List the runs of all folders that share the index.")
    ] = False,
    folder: arguments.Runs = Path("runs"),
    index: arguments.Index = None,
    json_: arguments.Json = None,
) -> None:
    """List the runs, newest first.

    Example: cellctl runs --search "sphere 925185" --verdict better
    """
    refuse_outputs({"--json": json_}, list(folder.glob("*/*")) if json_ not in (None, "-") else [])
    asked = RunFilter(search, state, verdict, serial, procedure, since, until)
    with current_index(folder) as found:
        if json_ is not None:
            listed = found.page(asked, everywhere=all_hosts)
            write_json({"runs": [_listed(each, place=all_hosts) for each in listed]}, json_)
        if json_ == "-":
            return
        rows = found.lines(asked, *_KEYS, everywhere=all_hosts)
    if not rows:
        none = f"No runs in {folder}. `cellctl run {first_procedure()}` makes one."
        typer.echo(none if asked == RunFilter() else f"No run in {folder} is as searched for.")
        return
    columns = ("place", *_COLUMNS) if all_hosts else _COLUMNS
    typer.echo("\n".join(_aligned([columns, *(tuple(str(each or "-") for each in row) for row in rows)])))


def _listed(found: FoundRun, *, place: bool) -> dict[str, Any]:
    return {**({"place": found.place} if place else {}), **as_json(summary_of(found))}


def _aligned(rows: list[tuple[str, ...]]) -> list[str]:
    line = "  ".join(f"{{:{max(map(len, column))}}}" for column in zip(*rows, strict=True))
    return [line.format(*row).rstrip() for row in rows]


app = typer.Typer(
    help="Make the index of the runs again, or compare it with the journals.",
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command()
def rebuild(folder: arguments.Runs = Path("runs"), index: arguments.Index = None, json_: arguments.Json = None) -> None:
    """Make the index of a folder of runs anew from all journals.

    Example: cellctl index rebuild --runs runs
    """
    found = _checked(rebuild_index, folder)
    write_json(as_json(found), json_)
    if json_ != "-":
        typer.echo(f"{found.index}: {found.runs} runs")


@app.command()
def verify(folder: arguments.Runs = Path("runs"), index: arguments.Index = None, json_: arguments.Json = None) -> None:
    """Read all journals, and compare them with the index; exit code 1 if they differ.

    Example: cellctl index verify --runs runs
    """
    found = _checked(verify_index, folder)
    write_json(as_json(found), json_)
    if json_ != "-":
        typer.echo(f"{found.index}: {found.runs} runs" + (", as in the journals" if found.agrees else ""))
        for names, what in ((found.missing, "not indexed"), (found.different, "other than in the journal")):
            if names:
                typer.echo(f"    {what}: {names_text(names)}")
        if found.vanished:
            typer.echo(f"    folder gone: {names_text(found.vanished)}")
    raise typer.Exit(0 if found.agrees else 1)


def _checked(check: Callable[[Path], IndexCheck], folder: Path) -> IndexCheck:
    try:
        return check(folder)
    except IndexUnusable as error:
        cure = "look at the database, or leave --index away: each folder then has an index of its own"
        raise InputError(Problem("--index", 0, 0, str(error), cure)) from error
