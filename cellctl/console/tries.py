"""Limits of tries to sign in: who fails has to wait, longer each time; nobody is locked out for good.

An address that failed 5 times waits 2, 4, 8 … 60 s after each further failure. So does a name that failed 10 times, up
to 10 s: many addresses together guess one name 8640 times a day at most. A name that signed in from an address does not
wait there for what other addresses tried: a stranger who tries names delays people at the own address alone. A success
does not take failures back, else an account of one's own would; an hour without a failure does.

Source: OWASP Authentication (account lockout; device cookies).
"""

from __future__ import annotations

import ipaddress
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeVar, final

_FREE: Final = {"address": 5, "name": 10}
_LONGEST_S: Final = {"address": 60.0, "name": 10.0}
_FORGOTTEN_S: Final = 3600.0
_MOST: Final = 10_000
"""Addresses and names, and pairs of them, that are kept; the oldest are forgotten first."""


@final
@dataclass(slots=True)
class Tries:
    """Failed tries, in memory. now: time, s."""

    now: Callable[[], float] = time.monotonic
    _failed: dict[tuple[str, str], tuple[int, float]] = field(default_factory=dict)
    _at_home: dict[tuple[str, str], None] = field(default_factory=dict)

    def wait_s(self, name: str, address: str) -> float:
        """The time until `name` may be tried from `address`, s; 0: now. The same for names that no user has."""
        place = _place(address)
        kinds = [("address", place)] if (name, place) in self._at_home else [("address", place), ("name", name)]
        return max(self._wait_s(*each) for each in kinds)

    def _wait_s(self, kind: str, key: str) -> float:
        number, last = self._failed.get((kind, key), (0, 0.0))
        since, over = self.now() - last, number - _FREE[kind]
        if over < 0 or since > _FORGOTTEN_S:
            return 0.0
        return max(0.0, min(2.0 ** min(over + 1, 10), _LONGEST_S[kind]) - since)

    def failed(self, name: str, address: str) -> None:
        """A try with a wrong name or password."""
        for key in (("address", _place(address)), ("name", name)):
            number, last = self._failed.pop(key, (0, 0.0))
            number = 0 if self.now() - last > _FORGOTTEN_S else number
            _add(self._failed, key, (number + 1, self.now()))

    def succeeded(self, name: str, address: str) -> None:
        """`name` signed in from `address`."""
        _add(self._at_home, (name, _place(address)), None)


K = TypeVar("K")
V = TypeVar("V")


def _add(known: dict[K, V], key: K, value: V) -> None:
    known.pop(key, None)
    known[key] = value
    if len(known) > _MOST:
        del known[next(iter(known))]


def _place(address: str) -> str:
    """The address; of IPv6 its network of 64 bits, which one stranger has as a whole."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if isinstance(found, ipaddress.IPv4Address) or found.ipv4_mapped:
        return str(found)
    return str(ipaddress.ip_network((found, 64), strict=False))
