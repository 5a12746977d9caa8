"""The place of the proxy, as the address in the cell file has it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final

from cellctl.devices import Address, impossible_host

PORT = 7000
EXAMPLE = "kuka+varproxy://172.31.1.147:7000"


@final
@dataclass(frozen=True, slots=True)
class ProxyPlace:
    """Host and port of the proxy on the controller's KLI network."""

    host: str
    port: int

    @classmethod
    def of(cls, address: Address) -> Self:
        """The place in an address. Raises ValueError for a missing host, a path, or a setting: there are none."""
        if not address.host or address.path.strip("/") or address.query:
            raise ValueError(f"'{address}' has to name a host, may name a port, and nothing else, as {EXAMPLE}")
        if why := impossible_host(address.host, reached=True):
            raise ValueError(f"'{address}': {why}")
        return cls(address.host, address.port or PORT)
