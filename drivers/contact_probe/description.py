"""What the driver tells cellctl about itself; from an address to a probe, with nothing opened yet."""

from __future__ import annotations

from cellctl.devices import Address, ContactProbe, DriverDescription, Surroundings
from drivers.contact_probe.probe import SerialProbe

_USUAL_BAUD = 250_000
_BAUDS = range(1200, 4_000_001)
_EXAMPLE = "contact+serial:///dev/ttyACM0?baud=250000"


def open_probe(name: str, address: Address, surroundings: Surroundings) -> ContactProbe:
    """The probe `name` at `address`; `connect` opens it.

    Raises ValueError for an address without a port, with a host, or with a setting other than `baud`.
    """
    if address.host or address.port is not None:
        raise ValueError(f"'{address}' has a host; a serial port's address has three slashes, as {_EXAMPLE}")
    if not address.path.strip("/"):
        raise ValueError(f"'{address}' names no serial port, as {_EXAMPLE}")
    unknown = sorted(set(address.query) - {"baud"})
    if unknown:
        raise ValueError(f"'{address}': the setting '{unknown[0]}' is not known; there is 'baud'")
    return SerialProbe(name, address.path, _baud(address), surroundings.clock)


def _baud(address: Address) -> int:
    text = address.query.get("baud", str(_USUAL_BAUD))
    if not (text.isascii() and text.isdigit() and int(text) in _BAUDS):
        raise ValueError(f"'{address}': baud has to be a whole number from 1200 to 4000000")
    return int(text)


DRIVER = DriverDescription(open_probe, ContactProbe)
