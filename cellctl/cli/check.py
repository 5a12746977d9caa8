"""`cellctl check`: every error in a procedure and its cell; opens no socket, moves nothing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.files import Problem


def check(
    procedure: arguments.Procedure,
    cell: arguments.OtherCell = None,
    set_: arguments.Settings = None,
    runs: arguments.Runs = Path("runs"),
    json_: arguments.Json = None,
) -> None:
    """Check a procedure and its cell; nothing moves.

    Prints all errors with file, line and remedy. Prints warnings too; they do not change the exit code.

    Example: cellctl check sphere_selfcal
    """
    from cellctl.cli.cell_warnings import show_warnings
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.files import InputError
    from cellctl.operations.campaign import load_campaign

    refuse_outputs({"--json": json_}, [procedure, cell])
    try:
        campaign = load_campaign(procedure, cell, set_ or [], runs=runs)
    except InputError as error:
        write_json({"procedure": str(procedure), "mistakes": _listed(error.problems)}, json_)
        raise
    show_warnings(campaign.cell)
    devices = sorted(campaign.cell.addresses)
    if json_ != "-":
        typer.echo(f"{procedure}: no errors found (cell '{campaign.cell.name}': {', '.join(devices)}).")
    found: dict[str, Any] = {"mistakes": [], "warnings": _listed(campaign.cell.warnings)}
    write_json({"procedure": str(procedure), "cell": campaign.cell.name, "devices": devices, **found}, json_)


def _listed(problems: Iterable[Problem]) -> list[dict[str, Any]]:
    return [asdict(problem) for problem in problems]
