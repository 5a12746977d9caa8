"""`cellctl check`: every mistake in a procedure and its cell; opens no socket, moves nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def check(
    procedure: Annotated[Path, typer.Argument(help="Procedure file.")],
    cell: Annotated[Path | None, typer.Option(help="Cell file instead of the one that the procedure names.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="A parameter, name=value.")] = None,
) -> None:
    """Name all mistakes in a procedure and its cell, each with file, line and cure; move nothing.

    Warnings, too: what is allowed and probably not meant. They leave the exit code as it is.

    Example: cellctl check procedures/sphere_selfcal.yaml
    """
    from cellctl.cli.cell_warnings import say_warnings
    from cellctl.operations.campaign import load_campaign

    campaign = load_campaign(procedure, cell, set_ or [])
    say_warnings(campaign.cell)
    devices = ", ".join(sorted(campaign.cell.addresses))
    typer.echo(f"{procedure}: no mistakes found (cell '{campaign.cell.name}': {devices}).")
