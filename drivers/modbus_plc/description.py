"""The description of this driver: its entry point."""

from __future__ import annotations

from cellctl.devices import Address, CellIO, DriverDescription, Surroundings, host_places
from drivers.modbus_plc.plc import ModbusPlc, PlcPlace, limits_of


def open_plc(name: str, address: Address, surroundings: Surroundings) -> CellIO:
    """The PLC `name` at `modbus+tcp://HOST:PORT?unit=1&words=high_first`; `connect` opens it.

    `words`: which word of a 32-bit value comes first, `high_first` or `low_first`. `surroundings.limits` may set
    `age_s` and `heartbeat_s`. Raises ValueError for an error in the address or the limits.
    """
    return ModbusPlc(name, PlcPlace.of(address), surroundings.clock, limits_of(surroundings.limits))


def _places(address: Address) -> frozenset[str]:
    place = PlcPlace.of(address)
    return host_places(place.host, place.port)


DRIVER = DriverDescription(open_plc, CellIO, places=_places)
