"""`cellctl krl`: writes the files that a cell's controller needs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cellctl.cli import arguments

if TYPE_CHECKING:
    from cellctl.devices.cell import Cell
    from cellctl.devices.registry import DriverRegistry


def krl(
    cell: arguments.Cell,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write to.")],
    device: Annotated[str | None, typer.Option(help="Device, if several have a controller to load.")] = None,
    load_to: Annotated[
        str | None, typer.Option(help="Folder on the controller to write the files to as well (C3 Bridge).")
    ] = None,
    json_: arguments.Json = None,
) -> None:
    """Write the files to load on the controller.

    KRL programs, EthernetKRL channel, Ethernet configuration, RSI context, README.txt. README.txt states where each
    file goes, and what has not been tried on a real controller yet. No device is opened, unless --load-to names a
    folder on the controller: then the files (not README.txt) are written there and read back.

    Example: cellctl krl sphere_cell -o krc
    """
    import asyncio

    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.devices.cell import Cell
    from cellctl.devices.registry import DriverRegistry
    from cellctl.operations.cell_devices import as_loaded, require_files, send_files

    refuse_outputs({"--json": json_}, [cell])
    drivers = DriverRegistry()
    loaded = Cell.load(cell, drivers)
    name, made = _made(loaded, drivers, device)
    if load_to is not None:
        require_files(loaded, drivers, name)
    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is a file; give a folder")
    out.mkdir(parents=True, exist_ok=True)
    for file, text in made.items():
        (out / file).write_bytes(as_loaded(text))
    sent = asyncio.run(send_files(loaded, drivers, name, load_to, made)) if load_to is not None else []
    if json_ != "-":
        typer.echo(f"{len(made)} files in {out}: {', '.join(made)}")
        typer.echo(f"Not tried on a real controller: read {out / 'README.txt'} before you load them.")
        for path in sent:
            typer.echo(f"Written to the controller and read back: {path}")
    write_json({"folder": str(out), "files": list(made), "sent": sent}, json_)


def _made(cell: Cell, drivers: DriverRegistry, device: str | None) -> tuple[str, dict[str, str]]:
    """The only device that has files for its controller, and these. Raises InputError if none has, or more than one."""
    from cellctl.clock import WallClock
    from cellctl.files import InputError

    if device is not None and device not in cell.addresses:
        known = ", ".join(sorted(cell.addresses))
        raise InputError(cell.document.problem((), f"has no device '{device}'", f"its devices: {known}"))
    found: dict[str, dict[str, str]] = {}
    for name, address in cell.addresses.items():
        if device in (None, name):
            files = drivers.controller_files(cell.name, address, cell.surroundings(name, WallClock()))
            if files is not None:
                found[name] = files
    if len(found) == 1:
        return next(iter(found.items()))
    what = f"several controllers can be loaded: {', '.join(found)}" if found else "has no controller to load files on"
    raise InputError(cell.document.problem((), what, "name one with --device" if found else ""))
