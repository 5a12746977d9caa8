"""`cellctl new`: the package of an extension, ready to install, run and test."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.operations.new_package import new_package

Kind = Literal["driver", "simulator", "campaign", "effect", "row-kind", "method"]


def new(
    kind: Annotated[Kind, typer.Argument(help="What the package brings.")],
    name: Annotated[str, typer.Argument(help="Name of the package and of what it brings, as dial_gauge.")],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder, new or empty. Default: the package's name.")
    ] = None,
    json_: arguments.Json = None,
) -> None:
    """Make a package with a driver, simulator, campaign, effect, row kind or compensation method of your own.

    It installs, runs and has tests that pass; replace its content by yours. A driver comes with a simulator, a campaign
    with both. docs/extend explains the files.

    Example: cellctl new driver laser_sensor -o laser_sensor
    """
    refuse_outputs({"--json": json_}, [])
    folder = out or Path(name)
    files = new_package(kind, name, folder)
    if json_ != "-":
        typer.echo(f"{len(files)} files in {folder}: {', '.join(str(file.relative_to(folder)) for file in files)}")
        typer.echo(f"next: pip install -e {folder} && pytest {folder} && cellctl check --package {name}")
    write_json({"folder": str(folder), "files": [str(file) for file in files]}, json_)
