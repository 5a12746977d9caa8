"""The place of the drives in an address: bus, nodes, and the meaning of their currents."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, Self, final

from cellctl.devices import Address

_SETTINGS = ("bitrate", "current", "nodes")
_HIGHEST_NODE = 127
_BITRATES = range(10_000, 1_000_001)

CURRENTS = {"6078": (0x6078, 1.0), "6077": (0x6077, 1.0), "6077/sqrt2": (0x6077, 1.0 / sqrt(2.0))}
"""Setting `current` → the object that carries the current, and factor to its per mille of 0x6075.

CiA 402: 0x6078 is per mille of the rated current 0x6075, and 0x6077 is per mille of the rated torque. Some drives
define 0x6077 by the rated current, or by rated current / √2 (Beckhoff EL72x1, depending on 0x2002:54).
"""


@final
@dataclass(frozen=True, slots=True)
class CanPlace:
    """`interface` and `channel` of python-can; `port`: of `udp_multicast`; `nodes`: in the order of the axes."""

    interface: str
    channel: str
    port: int | None
    bitrate: int | None
    nodes: tuple[int, ...]
    current: str

    @classmethod
    def of(cls, address: Address) -> Self:
        """The place in `canopen+INTERFACE://CHANNEL[:PORT]?nodes=…[&bitrate=…][&current=…]`. Raises ValueError."""
        if not address.host:
            raise ValueError(f"'{address}' names no bus, as canopen+socketcan://can0?nodes=1,2,3,4,5,6")
        unknown = sorted(set(address.query) - set(_SETTINGS))
        if unknown:
            raise ValueError(f"'{address}': the setting '{unknown[0]}' is not known; there are {', '.join(_SETTINGS)}")
        interface = address.scheme.removeprefix("canopen+").replace("-", "_")  # a URL's scheme has no underscore
        if (address.port is None) == (interface == "udp_multicast"):
            raise ValueError(f"'{address}': udp-multicast needs a port, the other interfaces have none")
        current = address.query.get("current", "6078")
        if current not in CURRENTS:
            raise ValueError(f"'{address}': current has to be one of {', '.join(CURRENTS)}")
        nodes = _nodes(address)
        return cls(interface, address.host, address.port, _bitrate(address), nodes, current)

    def bus_settings(self) -> dict[str, Any]:
        """Arguments of `can.Bus`. Frames over UDP multicast do not leave this computer (hop limit 0)."""
        found: dict[str, Any] = {"interface": self.interface, "channel": self.channel}
        if self.interface == "udp_multicast":
            found |= {"port": self.port, "hop_limit": 0, "fd": False}
        if self.bitrate:
            found["bitrate"] = self.bitrate
        return found

    def __str__(self) -> str:
        return f"{self.interface} {self.channel}" + (f":{self.port}" if self.port else "")


def _nodes(address: Address) -> tuple[int, ...]:
    words = address.query.get("nodes", "").split(",")
    nodes = tuple(int(word) for word in words if word.isascii() and word.isdigit())
    if len(nodes) < len(words) or len(set(nodes)) < len(nodes) or not all(1 <= node <= _HIGHEST_NODE for node in nodes):
        raise ValueError(
            f"'{address}': nodes has to be the different node numbers (1 … {_HIGHEST_NODE}) of A1, A2 …, as "
            "nodes=1,2,3,4,5,6"
        )
    return nodes


def _bitrate(address: Address) -> int | None:
    text = address.query.get("bitrate")
    if text is None:
        return None
    if not (text.isascii() and text.isdigit() and int(text) in _BITRATES):
        raise ValueError(f"'{address}': bitrate has to be a whole number from 10000 to 1000000")
    return int(text)
