"""The description of a driver, available before any device is opened."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import final

from cellctl.devices.addresses import Address
from cellctl.devices.protocols import Device, Finding, Surroundings


@final
@dataclass(frozen=True, slots=True)
class DriverDescription:
    """A driver, as its entry point in the group `cellctl.devices` yields it; the entry point's name is the URL scheme.

    `open(name, address, surroundings)`: makes the device of that name at that address; opens nothing; raises ValueError
    for an error in the address or the limits. `abilities`: the Protocol of `cellctl.devices`, or the driver's own
    class, with the abilities of its devices. The other fields are optional:

    `check_address(address, folder)`: errors in the files that the address names, paths read against `folder`.
    `check_setup(address, surroundings)`: findings about limits and address; `open` is then tried without the limits.
    `controller_files(cell, address, surroundings)`: file name → text of the files to load on the device's controller
    for the cell of that name; raises ValueError for errors in the address or the limits.
    `places(address)`: what the device occupies for itself, by `host_places` and `path_places`: two processes never use
    one place at once. Without it, the address's path, or its host and port.
    """

    open: Callable[[str, Address, Surroundings], Device]
    abilities: type
    check_address: Callable[[Address, Path], list[str]] | None = None
    check_setup: Callable[[Address, Surroundings], list[Finding]] | None = None
    controller_files: Callable[[str, Address, Surroundings], dict[str, str]] | None = None
    places: Callable[[Address], Iterable[str]] | None = None
