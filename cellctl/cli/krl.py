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
    json_: arguments.Json = None,
) -> None:
    """Write the files to load on the controller.

    KRL programs, EthernetKRL channel, Ethernet configuration, RSI context, README.txt. No device is opened. README.txt
    states where each file goes, and what has not been tried on a real controller yet.

    Example: cellctl krl sphere_cell -o krc
    """
    from cellctl.cli.outputs import refuse_outputs, write_json
    from cellctl.devices.cell import Cell
    from cellctl.devices.registry import DriverRegistry

    refuse_outputs({"--json": json_}, [cell])
    drivers = DriverRegistry()
    loaded = Cell.load(cell, drivers)
    made = _made(loaded, drivers, device)
    if out.exists() and not out.is_dir():
        raise typer.BadParameter(f"{out} is a file; give a folder")
    out.mkdir(parents=True, exist_ok=True)
    for name, text in made.items():
        (out / name).write_bytes(text.replace("\n", "\r\n").encode())
    if json_ != "-":
        typer.echo(f"{len(made)} files in {out}: {', '.join(made)}")
        typer.echo(f"Not tried on a real controller: read {out / 'README.txt'} before you load them.")
    write_json({"folder": str(out), "files": list(made)}, json_)


def _made(cell: Cell, drivers: DriverRegistry, device: str | None) -> dict[str, str]:
    """The files of the only device that has any. Raises InputError if none has, or more than one."""
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
        return next(iter(found.values()))
    what = f"several controllers can be loaded: {', '.join(found)}" if found else "has no controller to load files on"
    raise InputError(cell.document.problem((), what, "name one with --device" if found else ""))
