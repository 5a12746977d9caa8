"""What the address of the simulated laser station states: speed of the line, noise profile."""

from __future__ import annotations

from urllib.parse import parse_qsl, urlsplit

from sims.geocom._accuracy import DEFAULT

BAUD = 9_600
"""Of an address without `baud`: what instruments are delivered with."""


def baud_of(address: str) -> int:
    """Of the serial line, as the address has it. Raises ValueError where that is no whole number."""
    return int(_query(address).get("baud", BAUD))


def profile_of(address: str) -> str:
    """Name of the noise profile, as the address has it."""
    return _query(address).get("accuracy", DEFAULT)


def _query(address: str) -> dict[str, str]:
    return dict(parse_qsl(urlsplit(address).query))
