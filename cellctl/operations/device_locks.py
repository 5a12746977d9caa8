"""One process at a time for each real device: a lock for each of its places, in a folder that all users share.

The lock is the kernel's: it ends with its process, however that ends. Simulated cells need none: each run starts
simulators of its own.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self, final
from urllib.parse import quote

from cellctl.devices import DeviceBusy, Identity
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.files.locked import LockedByOther, LockedFile, locked_text
from cellctl.journal import Writer

VARIABLE = "CELLCTL_LOCKS"
"""Environment variable: the folder of the locks. Containers that reach one cell must share it."""

_NO_SERIAL = " 0?-.,:/"
"""A serial number of these characters alone is none: a device that was never given one reports 0 or nothing."""


@final
class DeviceLocks:
    """The locks that this process has on devices of a cell."""

    def __init__(self, cell: Cell, run: str) -> None:
        self._cell, self._run = cell, run
        self._held: dict[str, LockedFile] = {}

    @classmethod
    @contextmanager
    def held(
        cls, cell: Cell, drivers: DriverRegistry, *, names: Collection[str] | None = None, run: str = ""
    ) -> Iterator[Self]:
        """The locks of the devices `names` (None: of all), held inside this context; nothing is connected.

        run: name of the run that they are for, empty: a command. Raises DeviceBusy, with the run that has them.
        """
        locks = cls(cell, run)
        try:
            for place, device in sorted(_places(cell, drivers, names).items()):  # in one order, so that one of two wins
                locks._take(place, device)
            yield locks
        finally:
            for held in locks._held.values():
                held.release()

    def meet(self, identity: Identity) -> None:
        """Lock the serial number that a connected device reports: two addresses can lead to one device.

        Raises DeviceBusy if another process has this device by another address.
        """
        known = bool(identity.serial.strip(_NO_SERIAL))
        if known and not identity.simulated and not self._cell.simulated:
            maker = self._cell.addresses[identity.device].scheme.partition("+")[0]
            self._take(f"serial {maker} {identity.serial}", identity.device)

    def _take(self, place: str, device: str) -> None:
        """Lock a place; devices of this cell may share it."""
        if place in self._held:
            return
        text = Writer.this_process().text() + f"{self._run}\n"
        try:
            self._held[place] = LockedFile.take(_file(place), text, every_user=True)
        except LockedByOther as other:
            raise _busy(device, other.text) from None


def refuse_in_use(cell: Cell, drivers: DriverRegistry) -> None:
    """Raise DeviceBusy if another process has a device of this cell now."""
    for place, device in sorted(_places(cell, drivers, None).items()):
        if (text := locked_text(_file(place))) is not None:
            raise _busy(device, text)


def _places(cell: Cell, drivers: DriverRegistry, names: Collection[str] | None) -> dict[str, str]:
    """Place → device of a real cell."""
    listed = {} if cell.simulated else cell.addresses
    chosen = {name: address for name, address in listed.items() if names is None or name in names}
    return {place: name for name, address in chosen.items() for place in drivers.places(address)}


def _busy(device: str, text: str) -> DeviceBusy:
    writer, run = Writer.read(text), "".join(text.split("\n")[3:4])
    by = f"run {run} (process {writer.pid}, since {writer.since})" if run else f"process {writer.pid}: {writer.command}"
    end = f"`cellctl abort {run}`" if run else f"kill {writer.pid}"
    return DeviceBusy(device, f"is in use by {by}", f"wait for its end, or end it ({end}); then try again")


def _file(place: str) -> Path:
    """The lock file of a place. Raises OSError if the folder cannot be made."""
    folder = _folder()
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o1777)  # as /tmp: every user makes files, nobody removes those of others
    return folder / quote(place, safe=" :,")


def _folder() -> Path:
    """One folder for all users of this computer: the choice must not depend on who asks, nor on TMPDIR."""
    if stated := os.environ.get(VARIABLE):
        return Path(stated)
    usual = Path("/run/lock")
    for_all = usual.is_dir() and bool(usual.stat().st_mode & stat.S_IWOTH)
    return (usual if for_all else Path("/tmp")) / "cellctl"
