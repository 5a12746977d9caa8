"""The line speed that the address of the simulated probe states, and the events that it announces."""

from __future__ import annotations

from urllib.parse import parse_qsl, urlsplit

ARM, CONTACT = "probe.arm", "probe.contact"
BAUD = 250_000


def baud_of(address: str) -> int:
    """Of the serial line, as the address has it. Raises ValueError where that is no whole number."""
    return int(dict(parse_qsl(urlsplit(address).query)).get("baud", BAUD))
