"""Addresses of devices: URLs whose scheme names a driver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self, final
from urllib.parse import parse_qsl, urlencode, urlsplit


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
        return cls(parts.scheme, parts.hostname or "", port, parts.path, dict(pairs))

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        port = "" if self.port is None else f":{self.port}"
        query = f"?{urlencode(self.query, safe='/:')}" if self.query else ""
        return f"{self.scheme}://{host}{port}{self.path}{query}"
