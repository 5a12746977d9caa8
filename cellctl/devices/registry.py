"""Drivers by URL scheme, found through the entry point group `cellctl.devices`, loaded when first needed."""

from __future__ import annotations

import difflib
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from typing import final

from cellctl.devices._addresses import Address, DriverDescription, places_of
from cellctl.devices._protocols import Device, Finding, Surroundings


@final
class DriverRegistry:
    """The installed drivers."""

    def __init__(self) -> None:
        self._entries: dict[str, EntryPoint] = {entry.name: entry for entry in entry_points(group="cellctl.devices")}

    def schemes(self) -> list[str]:
        """The URL schemes that a cell file may use."""
        return sorted(self._entries)

    def driver(self, scheme: str) -> DriverDescription:
        """The driver for `scheme`. Raises ValueError if there is none, or if it cannot be loaded."""
        entry = self._entries.get(scheme)
        if entry is None:
            near = difflib.get_close_matches(scheme, self.schemes(), n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"installed: {', '.join(self.schemes())}"
            raise ValueError(f"no driver for '{scheme}://' ({hint})")
        try:
            driver = entry.load()
        except Exception as error:
            raise ValueError(f"the driver for '{scheme}://' ({entry.value}) cannot be loaded: {error}") from error
        if not isinstance(driver, DriverDescription):
            raise ValueError(f"the driver for '{scheme}://' ({entry.value}) is not a DriverDescription")
        return driver

    def abilities(self, scheme: str) -> type:
        """The Protocol or class with the abilities of the devices of `scheme`. Raises ValueError."""
        return self.driver(scheme).abilities

    def open(self, name: str, address: Address, surroundings: Surroundings) -> Device:
        """The device `name` at `address`; opens nothing. Raises ValueError."""
        return self.driver(address.scheme).open(name, address, surroundings)

    def findings(self, name: str, address: Address, surroundings: Surroundings) -> list[Finding]:
        """Errors and warnings about an address, its settings and limits; opens nothing."""
        try:
            driver = self.driver(address.scheme)
            driver.open(name, address, replace(surroundings, limits={}) if driver.check_setup else surroundings)
        except ValueError as error:
            return [Finding(str(error))]
        errors = driver.check_address(address, surroundings.folder) if driver.check_address else []
        found = driver.check_setup(address, surroundings) if driver.check_setup else []
        return [*map(Finding, errors), *found]

    def controller_files(self, cell: str, address: Address, surroundings: Surroundings) -> dict[str, str] | None:
        """File name → text of the files to load on the device's controller; None if its driver has none.

        Raises ValueError for errors in the address or the limits.
        """
        generate = self.driver(address.scheme).controller_files
        return generate(cell, address, surroundings) if generate else None

    def places(self, address: Address) -> frozenset[str]:
        """What the device at `address` occupies for itself. Resolves names of hosts. Raises ValueError."""
        stated = self.driver(address.scheme).places
        return frozenset(stated(address)) if stated else places_of(address)
