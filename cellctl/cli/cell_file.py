"""`cellctl cell`: writes a cell file for a robot of the library."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import write_json
from cellctl.operations.cell_making import make_cell


def cell(
    robot: Annotated[str, typer.Argument(help="Robot of the library: see `cellctl robots`.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Cell file to write.")],
    probe: Annotated[bool, typer.Option("--probe", help="With a contact probe and spheres.")] = False,
    tracker: Annotated[bool, typer.Option("--tracker", help="With a laser station and reflectors.")] = False,
    plc: Annotated[bool, typer.Option("--plc", help="With the cell's PLC, which tracker campaigns watch.")] = False,
    json_: arguments.Json = None,
) -> None:
    """Write a checked cell file for a robot of the library.

    It runs on simulators as it is. FILL IN marks what is to be replaced on a real cell. A robot file with the probe as
    tool, and files for the controller, are written beside it.

    Example: cellctl cell ur5e --probe --tracker --plc -o my_cell.yaml
    """
    if not (probe or tracker):
        raise typer.BadParameter("name what measures: --probe, --tracker or both")
    made = make_cell(robot, out, probe=probe, tracker=tracker, plc=plc)
    if json_ != "-":
        typer.echo(f"{', '.join(map(str, made.files))}: devices {', '.join(made.devices)}")
        for procedure in made.procedures:
            typer.echo(f"checked: cellctl run {procedure} --cell {out}")
        if tracker and not plc:
            typer.echo("without --plc: tracker campaigns that watch the cell's PLC do not run on it")
        typer.echo("On a real cell, replace what FILL IN marks and delete `simulate:`.")
    write_json(
        {"files": list(map(str, made.files)), "devices": list(made.devices), "checked": list(made.procedures)}, json_
    )
