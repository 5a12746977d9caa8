"""The description of this driver: its entry point."""

from __future__ import annotations

from pathlib import Path

from cellctl.devices import Address, ContactProbe, DriverDescription, Surroundings
from drivers.contact_probe.probe import SerialProbe
from drivers.serial_port import SerialPlace

_DEFAULT_BAUD = 250_000


def open_probe(name: str, address: Address, surroundings: Surroundings) -> ContactProbe:
    """The probe `name` at `contact+serial:///dev/ttyACM0?baud=250000`; `connect` opens it.

    Raises ValueError for an address without a port, with a host, or with a setting other than `baud`; for any limit.
    """
    if surroundings.limits:
        raise ValueError("a probe has no limits; those of a search are the robot's")
    place = SerialPlace.of(address, _DEFAULT_BAUD)
    unknown = sorted(set(address.query) - {"baud"})
    if unknown:
        raise ValueError(f"'{address}': the setting '{unknown[0]}' is not known; there is 'baud'")
    return SerialProbe(name, place, surroundings.clock)


DRIVER = DriverDescription(open_probe, ContactProbe, firmware=Path(__file__).parent / "firmware")
