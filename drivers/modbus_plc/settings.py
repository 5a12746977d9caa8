"""The PLC's place and limits, as the cell file has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, final

from cellctl.devices import Address, impossible_host
from drivers.modbus_plc.io_map import WordOrder
from drivers.modbus_plc.polling import PollLimits

_EXAMPLE = "modbus+tcp://192.168.10.5:502?unit=1&words=high_first"
_PORT = 502
_WORDS: dict[str, WordOrder] = {"high_first": "high_first", "low_first": "low_first"}
_CEILINGS = {"age_s": 2.0, "heartbeat_s": 5.0}
_LEAST_S = 0.2


@final
@dataclass(frozen=True, slots=True)
class PlcPlace:
    """Host, port, unit id, and the order of the words of a 32-bit value."""

    host: str
    port: int
    unit: int
    words: WordOrder

    @classmethod
    def of(cls, address: Address) -> Self:
        """The place in an address. Raises ValueError for a missing host, a path, or a wrong setting."""
        if not address.host or address.path.strip("/"):
            raise ValueError(f"'{address}' has to name a host and no path, as {_EXAMPLE}")
        if why := impossible_host(address.host, reached=True):
            raise ValueError(f"'{address}': {why}")
        unknown = sorted(set(address.query) - {"unit", "words"})
        if unknown:
            raise ValueError(f"'{address}': the setting '{unknown[0]}' is not known; there are 'unit' and 'words'")
        unit = address.query.get("unit", "1")
        if not (unit.isascii() and unit.isdigit() and int(unit) <= 255):
            raise ValueError(f"'{address}': unit has to be a whole number from 0 to 255")
        words = _WORDS.get(address.query.get("words", "high_first"))
        if words is None:
            raise ValueError(f"'{address}': words has to be high_first or low_first")
        return cls(address.host, address.port or _PORT, int(unit), words)


def limits_of(stated: Mapping[str, float]) -> PollLimits:
    """The limits in the cell file; missing ones take the defaults. Raises ValueError."""
    for name, value in stated.items():
        if name not in _CEILINGS:
            raise ValueError(f"unknown limit '{name}'; there are {' and '.join(_CEILINGS)}")
        if not _LEAST_S <= value <= _CEILINGS[name]:
            raise ValueError(f"limit {name} {value:g} is outside {_LEAST_S:g} … {_CEILINGS[name]:g} s")
    return PollLimits(**stated)
