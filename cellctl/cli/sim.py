"""`cellctl sim`: runs a cell's simulators until Ctrl-C."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path
from typing import Annotated, Literal

import typer

from cellctl.cli import arguments


def sim(
    cell: arguments.Cell,
    clock: Annotated[Literal["realtime", "lockstep"] | None, typer.Option(help="Time of the cell.")] = None,
    seed: arguments.Seed = None,
    ready: Annotated[Path | None, typer.Option(help="Write the device addresses to this file once all listen.")] = None,
) -> None:
    """Run a cell's simulators until Ctrl-C.

    Example: cellctl sim sphere_cell --clock realtime --ready /tmp/ready.json
    """
    from cellctl.cli.outputs import refuse_outputs
    from cellctl.devices.cell import Cell
    from cellctl.devices.registry import DriverRegistry
    from cellctl.files import InputError
    from cellctl.operations.cell_devices import require_cells, simulator_command

    refuse_outputs({"--ready": ready}, [cell])
    require_cells()
    loaded = Cell.load(cell, DriverRegistry())
    if not loaded.simulated:
        cure = "add it, or run against the real cell"
        raise InputError(loaded.document.problem((), "this cell has no `simulate:` section", cure))
    process = subprocess.Popen(simulator_command(cell, seed, clock, ready), start_new_session=True)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: process.terminate())
    raise typer.Exit(process.wait())
