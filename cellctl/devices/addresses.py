"""Addresses of devices: URLs whose scheme names a driver."""

from __future__ import annotations

import re
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Self, final
from urllib.parse import parse_qsl, urlencode, urlsplit

_LABEL = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?")


def impossible_host(host: str, *, reached: bool = False) -> str:
    """Why there can be no host of this name or number; empty: there can. reached: it is connected to, not bound.

    Nothing is looked up. Source: RFC 1123, section 2.1 (with underscores, as names of buses and Windows have them).
    """
    try:
        number = ip_address(host.partition("%")[0])
    except ValueError:
        if re.fullmatch(r"[0-9.]+|.*:.*", host):
            return f"there can be no host '{host}': it is no IP address"
        labels = host.removesuffix(".").split(".")
        named = len(host) <= 253 and all(_LABEL.fullmatch(label) for label in labels)
        return "" if named else f"there can be no host '{host}': a name has letters, digits, '-' and '.'"
    if reached and (number.is_unspecified or number.is_multicast or str(number) == "255.255.255.255"):
        return f"'{host}' is the address of no device: it stands for several"
    return ""


@final
@dataclass(frozen=True, slots=True)
class Address:
    """A device's address, `kuka+rsi://0.0.0.0:49152?ethernet=rsi_ethernet.xml&eki=10.0.0.2:54600`.

    `path` is the URL's path as written (`/dev/ttyACM0`); `query` its settings.
    """

    scheme: str
    host: str
    port: int | None
    path: str
    query: dict[str, str]

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read an address. Raises ValueError that describes the error."""
        try:
            parts = urlsplit(text)
            port = parts.port
            pairs = parse_qsl(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        except ValueError as error:
            raise ValueError(f"'{text}' is no device address: {error}") from error
        if not parts.scheme or not text.lower().startswith(f"{parts.scheme}://"):
            raise ValueError(f"'{text}' is no device address (scheme://…)")
        if parts.fragment or "@" in parts.netloc:
            raise ValueError(f"'{text}': a device address has no user and no '#'")
        if len(dict(pairs)) != len(pairs):
            raise ValueError(f"'{text}' gives a setting twice")
        host = parts.hostname or ""
        if host and (why := impossible_host(host)):
            raise ValueError(f"'{text}': {why}")
        return cls(parts.scheme, host, port, parts.path, dict(pairs))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        port = "" if self.port is None else f":{self.port}"
        query = f"?{urlencode(self.query, safe='/:')}" if self.query else ""
        return f"{self.scheme}://{host}{port}{self.path}{query}"
