"""`cellctl runs` and `cellctl show`: list and show runs, from the journals alone."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.journal import RunState

_COLUMNS = ["run", "began", "state", "points", "verdict", "table"]
_KEYS = ("run", "began", "state", "points", "verdict", "table_state")


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
    folder: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """List the runs, newest first.

    Example: cellctl runs --search "sphere 925185" --verdict better
    """
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.operations.run_list import RunFilter, run_rows

    refuse_outputs({"--json": json_}, list(folder.glob("*/*")))
    asked = RunFilter(search, state, verdict, serial, procedure, since, until)
    found = run_rows(folder, asked)
    write_json({"runs": found}, json_)
    if json_ == "-":
        return
    if not found:
        none = f"No runs in {folder}. `cellctl run sphere_selfcal` makes one."
        typer.echo(none if asked == RunFilter() else f"No run in {folder} is as searched for.")
        return
    for line in _aligned([_COLUMNS, *([str(row.get(key) or "-") for key in _KEYS] for row in found)]):
        typer.echo(line)


def show(
    run: arguments.Run,
    folder: arguments.Runs = Path("runs"),
    events: Annotated[bool, typer.Option(help="Show every event.")] = False,
    against: Annotated[
        Path | None, typer.Option(help="Another run: show both side by side, with the difference of their models.")
    ] = None,
    json_: arguments.Json = None,
) -> None:
    """Show one run: devices, steps, verdict; or compare it with another.

    Example: cellctl show sphere_selfcal-20261121T192433Z --events
    """
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.journal import fold, read_journal, run_place
    from cellctl.operations.run_list import run_summary

    place = run_place(run, folder)
    refuse_outputs({"--json": json_}, [place, *place.glob("*")])
    if against is not None:
        _compare(place, run_place(against, folder), json_)
        return
    entries = list(read_journal(place))
    state = fold(entries)
    summary = run_summary(place, state)
    write_json(summary, json_)
    if json_ == "-":
        return
    for line in _lines(summary, state):
        typer.echo(line)
    if events:
        for entry in entries:
            typer.echo(f"{entry.seq:6d} {entry.time_ns * 1e-9:12.3f} s  {entry.event}")


def _compare(a: Path, b: Path, json_: str | None) -> None:
    from cellctl.cli.compared_words import compared_words
    from cellctl.cli.outputs import write_json
    from cellctl.operations.comparing_runs import compare_runs

    found = compare_runs(a, b)
    write_json(found.to_json(), json_)
    if json_ != "-":
        for line in compared_words(found):
            typer.echo(line)


def _aligned(rows: list[list[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]


def _lines(summary: dict[str, Any], state: RunState) -> list[str]:
    lines = [
        f"{summary['run']}: {summary['state']}",
        f"  procedure  {summary['procedure']}",
        f"  cell       {summary['cell']} ({summary['clock']}, seed {summary['seed']})",
        f"  began      {summary['began']}, {summary['cell_s']:.1f} s of the cell's time",
    ]
    if summary["process"]:
        lines.append(f"  run by     process {summary['process']}")
    lines += [
        f"  {name:10} {identity['model']}, serial {identity['serial']}" for name, identity in state.identities.items()
    ]
    attempts = f"attempts at steps: {summary['attempts']} in {len(state.steps)} steps"
    lines.append(f"  points     {summary['points']} measured; {attempts}")
    if summary["verdict"]:
        lines.append(f"  verdict    {summary['verdict']}: {summary['sentence']}")
    if summary["table_words"]:
        lines.append(f"  table      {summary['table_words']}")
    lines += [f"  {line}" for line in summary["lines"]]
    if summary["problem"]:
        lines += [f"  ended by   {summary['problem']}", f"  cure       {summary['cure']}"]
    return lines
