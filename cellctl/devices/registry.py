"""Drivers by URL scheme, found through the entry point group `cellctl.devices`, loaded when first needed."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from typing import final

from cellctl import devices
from cellctl.devices.addresses import Address
from cellctl.devices.protocols import Device, Finding, Surroundings

OpenDevice = Callable[[str, Address, Surroundings], Device]
"""A driver's entry point: makes the device of that name at that address; opens nothing. Raises ValueError."""


@final
class DriverRegistry:
    """The installed drivers."""

    def __init__(self) -> None:
        self._entries: dict[str, EntryPoint] = {entry.name: entry for entry in entry_points(group="cellctl.devices")}

    def schemes(self) -> list[str]:
        """The URL schemes that a cell file may use."""
        return sorted(self._entries)

    def driver(self, scheme: str) -> OpenDevice:
        """The driver for `scheme`. Raises ValueError where there is none, or where it cannot be loaded."""
        entry = self._entries.get(scheme)
        if entry is None:
            near = difflib.get_close_matches(scheme, self.schemes(), n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"installed: {', '.join(self.schemes())}"
            raise ValueError(f"no driver for '{scheme}://' ({hint})")
        try:
            opener: OpenDevice = entry.load()
        except Exception as error:
            raise ValueError(f"the driver for '{scheme}://' ({entry.value}) cannot be loaded: {error}") from error
        return opener

    def kind(self, scheme: str) -> type:
        """What the driver's devices can do: the class or Protocol that its function says it returns.

        An annotation by name is looked up in `cellctl.devices`, so that a driver need not import them to say it.
        """
        said = self.driver(scheme).__annotations__.get("return", Device)
        kind = getattr(devices, said, None) if isinstance(said, str) else said
        return kind if isinstance(kind, type) else Device

    def open(self, name: str, address: Address, surroundings: Surroundings) -> Device:
        """The device `name` at `address`; opens nothing. Raises ValueError."""
        return self.driver(address.scheme)(name, address, surroundings)

    def findings(self, name: str, address: Address, surroundings: Surroundings) -> list[Finding]:
        """What is wrong with, or to be doubted about, an address, its settings and limits; opens nothing.

        A driver's module may have `check_address(address, folder)`, which names mistakes in what the address names, and
        `check_setup(address, surroundings)`, which gives findings about limits and address.
        """
        try:
            opener = self.driver(address.scheme)
            module = sys.modules[self._entries[address.scheme].module]
            check_address, check_setup = (getattr(module, hook, None) for hook in ("check_address", "check_setup"))
            opener(name, address, replace(surroundings, limits={}) if check_setup else surroundings)
        except ValueError as error:
            return [Finding(str(error))]
        found = [Finding(what) for what in check_address(address, surroundings.folder)] if check_address else []
        return found + (list(check_setup(address, surroundings)) if check_setup else [])

    def controller_files(self, cell: str, address: Address, surroundings: Surroundings) -> dict[str, str] | None:
        """File name → text of what has to be loaded on the device's controller; None where its driver has none.

        Raises ValueError with what is wrong with the address or the limits.
        """
        self.driver(address.scheme)
        module = sys.modules[self._entries[address.scheme].module]
        generate = getattr(module, "generate_controller_files", None)
        if generate is None:
            return None
        return dict(generate(cell, address, surroundings.folder, surroundings.limits, surroundings.reach_mm))
