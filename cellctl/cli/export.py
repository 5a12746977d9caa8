"""`cellctl export`: writes a run for other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, final

import typer

from cellctl.cli import arguments


@final
class Form(StrEnum):
    """The forms of an export, as the help lists them without loading the exports."""

    CSV = "csv"
    PARQUET = "parquet"
    JSONL = "jsonl"
    BLUESKY = "bluesky"
    ZIP = "zip"


def export(
    run: arguments.Run,
    as_: Annotated[
        Form,
        typer.Option(
            "--as",
            help="csv, parquet: samples. jsonl: events. bluesky: event-model documents. zip: everything of the run.",
        ),
    ] = Form.ZIP,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Output file. Default: RUN-samples.csv, RUN-run.zip … in this folder."),
    ] = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Export a run: its samples as CSV or Parquet, its events as JSON lines or bluesky documents, or all in one zip.

    The run may be running, aborted or damaged: what can be read is exported, the rest is named (exit code 2).

    Example: cellctl export sphere_selfcal-20261121T192433Z --as csv -o samples.csv
    """
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.files import write_atomically
    from cellctl.journal import journal_in, run_place
    from cellctl.operations import export as exports

    place, form = run_place(run, runs), exports.Form(as_.value)
    folder = journal_in(place).parent
    target = out or Path(f"{folder.resolve().name}-{form.file_name}")
    refuse_outputs({"--out": target, "--json": json_}, [place, *folder.glob("*")])
    found = exports.export_run(place, form)
    write_atomically(target, found.content)
    counts = {"samples": found.samples, "events": found.events}
    result = {"run": folder.resolve().name, "form": form.value, "file": str(target), **counts}
    write_json({**result, "missing": list(found.missing)}, json_)
    if json_ != "-":
        typer.echo(f"{target}: {found.samples} samples, {found.events} events")
    found.refuse_missing(place, target)
