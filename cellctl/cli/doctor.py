"""`cellctl doctor`: connects to every device of a cell, and shows identity, latency, clock and health of each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import typer

from cellctl.cli import arguments
from cellctl.cli.ends import Exit

if TYPE_CHECKING:
    from cellctl.operations.doctor import Examined

_WIDTH = 120


def doctor(cell: arguments.Cell, seed: arguments.Seed = None, json_: arguments.Json = None) -> None:
    """Connect to every device of a cell and report its health; nothing moves.

    One row for each device: identity, firmware, latency, fit of its clock to the cell's, health. A device that fails
    does not keep the others from being tried. Exit code 0: all are healthy; 3: one is not.

    Example: cellctl doctor sphere_cell
    """
    import asyncio

    from cellctl.cli.cell_warnings import show_warnings
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.devices.cell import Cell
    from cellctl.devices.registry import DriverRegistry
    from cellctl.operations.cell_devices import require_cells
    from cellctl.operations.doctor import examine

    refuse_outputs({"--json": json_}, [cell])
    require_cells()
    drivers = DriverRegistry()
    loaded = Cell.load(cell, drivers)
    show_warnings(loaded)
    found = asyncio.run(examine(loaded, drivers, seed))
    if json_ != "-":
        _show(found)
    devices = [one.dump() for one in found]
    healthy = all(one.healthy for one in found)
    write_json({"cell": loaded.name, "simulated": loaded.simulated, "healthy": healthy, "devices": devices}, json_)
    for one in found:
        if not one.healthy:
            typer.echo(f"cellctl: {one.name}: {one.what}\n    {one.cure}", err=True)
    if not healthy:
        raise typer.Exit(Exit.DEVICE_FAILED)


def _show(found: Sequence[Examined]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False)
    console.width = max(console.width, _WIDTH)  # a narrow terminal may fold a line, but not truncate an identity
    table = Table(box=None, pad_edge=False)
    for title in ("device", "identity", "firmware"):
        table.add_column(title, overflow="fold")
    table.add_column("latency", justify="right", no_wrap=True)
    table.add_column("clock", no_wrap=True)
    table.add_column("health", overflow="fold")
    for one in found:
        table.add_row(*_cells(one), style="" if one.healthy else "red")
    console.print(table)


def _cells(one: Examined) -> list[str]:
    from rich.markup import escape

    identity = one.identity
    named = f"{identity.model} {identity.serial}" if identity and identity.serial not in identity.model else ""
    clock = one.clock
    cells = [
        one.name,
        named or (identity.model if identity else "–"),
        (identity.firmware if identity else "") or "–",
        "–" if one.latency_ms is None else f"{one.latency_ms:.1f} ms",
        f"{clock.drift_ppm:+.1f} ppm ± {clock.sigma_ms * 1e3:.0f} µs" if clock else "–",
        f"ok: {one.health.text}" if one.healthy and one.health else f"FAILED: {one.what}",
    ]
    return [escape(cell) for cell in cells]
