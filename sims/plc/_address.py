"""What the address of the simulated PLC states: unit, order of words; and the event that it announces."""

from __future__ import annotations

from urllib.parse import parse_qsl, urlsplit

HEARTBEAT = "plc.heartbeat"
UNIT = 1


def unit_of(address: str) -> int:
    """The unit id in the address. Raises ValueError where that is no number from 0 to 255."""
    unit = int(_query(address).get("unit", UNIT))
    if not 0 <= unit <= 255:
        raise ValueError(f"unit {unit}")
    return unit


def low_first(address: str) -> bool:
    """Whether the low word of a 32-bit value comes first."""
    return _query(address).get("words") == "low_first"


def _query(address: str) -> dict[str, str]:
    return dict(parse_qsl(urlsplit(address).query))
