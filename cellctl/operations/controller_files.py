"""Writes generated files to a controller whose driver can do that, and reads them back."""

from __future__ import annotations

from collections.abc import Mapping

from cellctl.devices import FileStore
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files import InputError
from cellctl.operations.connected import connected
from cellctl.operations.system import require_cells
from cellctl.procedure.check import missing_abilities

_INSTRUCTIONS = "README.txt"


def as_loaded(text: str) -> bytes:
    """A generated file's text with the line ends of Windows, which the controller needs."""
    return text.replace("\n", "\r\n").encode()


def require_files(cell: Cell, drivers: DriverRegistry, device: str) -> None:
    """Raises InputError if this device of the cell cannot write files to its controller; opens nothing."""
    scheme = cell.addresses[device].scheme
    if missing_abilities(drivers.abilities(scheme), FileStore):
        what = f"{device}: a driver for {scheme} cannot write files to its controller"
        raise InputError(cell.document.problem(("devices", device), what, "load them by hand, as README.txt states"))


async def send_files(
    cell: Cell, drivers: DriverRegistry, device: str, folder: str, files: Mapping[str, str]
) -> list[str]:
    r"""Write the files (name → text) but the instructions to `folder` (`KRC:\R1\PROGRAM`); their paths there.

    Each is read back and compared. Raises DeviceError: the files before it are written, the others are not.
    """
    require_cells()
    sent = []
    async with connected(cell, drivers, [device]) as devices:
        for name, text in files.items():
            if name != _INSTRUCTIONS:
                path = folder.rstrip("/\\") + "\\" + name
                await devices[device].device.write_file(path, as_loaded(text))
                sent.append(path)
    return sent
