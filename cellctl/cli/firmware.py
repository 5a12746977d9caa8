"""`cellctl firmware`: sources, schematic and program of a device that one builds oneself."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from cellctl.cli import arguments
from cellctl.cli.arguments import refuse_outputs, write_json
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError, Problem


def firmware(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write to, new or empty.")],
    scheme: Annotated[str, typer.Option(help="URL scheme of the device.")] = "contact+serial",
    json_: arguments.Json = None,
) -> None:
    """Write the contact probe's firmware, to load or to build it.

    Sources and Makefile, the program contact_probe.hex, the circuit schematic.svg. README.md states how to build the
    circuit, set the fuses and load the program with avrdude. No device is opened.

    Example: cellctl firmware -o probe
    """
    refuse_outputs({"--json": json_}, [])
    folder = _firmware_of(scheme)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        what = "is not empty" if out.is_dir() else "is a file"
        raise InputError(Problem(str(out), 0, 0, what, "give -o a new or empty folder"))
    names = sorted(file.name for file in folder.iterdir() if file.is_file() and not file.name.startswith("."))
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name in names:
            shutil.copyfile(folder / name, out / name)
    except OSError as error:
        where, what = str(error.filename2 or error.filename), f"could not be written: {error.strerror or error}"
        raise InputError(Problem(where, 0, 0, what, "give -o another folder")) from error
    if json_ != "-":
        typer.echo(f"{len(names)} files in {out}: {', '.join(names)}")
        typer.echo(f"The circuit has not been built and measured yet: read {out / 'README.md'} first.")
    write_json({"folder": str(out), "files": names}, json_)


def _firmware_of(scheme: str) -> Path:
    try:
        folder = DriverRegistry().driver(scheme).firmware
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--scheme") from error
    if folder is None:
        raise typer.BadParameter(f"cellctl has no firmware for '{scheme}://'", param_hint="--scheme")
    return folder
