"""Options that several verbs of `cellctl table` share, and how they record changes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from cellctl.operations.table import TableRecorder

State = Annotated[Path | None, typer.Option(help="File that keeps a simulated cell's state between calls.")]
Runs = Annotated[Path, typer.Option("--runs", help="Folder of the runs; the history of tables is in it.")]


@contextmanager
def recorded(runs: Path, serial: str) -> Iterator[TableRecorder]:
    """Records changes of controller `serial`; a history that cannot be written is reported on stderr."""
    from cellctl.operations.table import TableRecorder
    from cellctl.operations.table_history import TableHistory

    recorder = TableRecorder(TableHistory(runs, serial))
    try:
        yield recorder
    finally:
        if recorder.failure:
            typer.echo(f"cellctl: {recorder.failure}", err=True)


def show_result(json_: str | None, result: dict[str, Any], words: str) -> None:
    """The words on stdout, the JSON where it is asked for."""
    from cellctl.cli.outputs import write_json

    if json_ != "-" and words:  # first: the table is active even if writing the file fails
        typer.echo(words)
    write_json(result, json_)
