"""Addresses of devices: URLs whose scheme names a driver; the places that they occupy; a driver's description."""

from __future__ import annotations

import os
import re
import socket
import stat
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from ipaddress import IPv6Address, ip_address
from pathlib import Path
from typing import Self, final
from urllib.parse import parse_qsl, urlencode, urlsplit

from cellctl.devices._protocols import Device, Finding, Surroundings

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


def places_of(address: Address) -> frozenset[str]:
    """The places of a device whose driver states none: the file of its path, else host and port."""
    if address.path.strip("/"):
        return path_places(address.path)
    return host_places(address.host, address.port)


def path_places(path: str) -> frozenset[str]:
    """The place of a serial port: its number. It has several names (`/dev/ttyUSB0`, `/dev/serial/by-id/…`)."""
    try:
        found = Path(path).stat()
    except OSError:
        return frozenset({f"file {os.path.realpath(path)}"})
    if stat.S_ISCHR(found.st_mode):
        return frozenset({f"terminal {os.major(found.st_rdev)}:{os.minor(found.st_rdev)}"})
    return frozenset({f"file {os.path.realpath(path)}"})


def host_places(host: str, port: int | None = None) -> frozenset[str]:
    """The places of a host's port, or of the whole host (no port): one for each of its IP addresses.

    A name is resolved, so that name and number are one place. The whole of this computer (127.0.0.1) is no place:
    programs on it have ports of their own.
    """
    found = set()
    for each in _numbers(host):
        if port is not None:
            found.add(f"host {each} port {port}")
        elif not _is_here(each):
            found.add(f"host {each}")
    return frozenset(found)


def _numbers(host: str) -> set[str]:
    try:
        return {_plain(str(info[4][0])) for info in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)}
    except (OSError, UnicodeError):
        return {host.lower().rstrip(".")}


def _plain(number: str) -> str:
    """An IP address in one way of writing; `::ffff:10.0.0.5` is 10.0.0.5."""
    try:
        found = ip_address(number.partition("%")[0])
    except ValueError:
        return number
    if isinstance(found, IPv6Address) and found.ipv4_mapped:
        return str(found.ipv4_mapped)
    return str(found)


def _is_here(number: str) -> bool:
    try:
        return ip_address(number).is_loopback
    except ValueError:
        return number == "localhost"


@final
@dataclass(frozen=True, slots=True)
class DriverDescription:
    """A driver, as its entry point in the group `cellctl.devices` yields it; the entry point's name is the URL scheme.

    `open(name, address, surroundings)`: makes the device of that name at that address; opens nothing; raises ValueError
    for an error in the address or the limits. `abilities`: the Protocol of `cellctl.devices`, or the driver's own
    class, with the abilities of its devices. The other fields are optional:

    `check_address(address, folder)`: errors in the files that the address names, paths read against `folder`.
    `check_setup(address, surroundings)`: findings about limits and address; `open` is then tried without the limits.
    `controller_files(cell, address, surroundings)`: file name → text of the files to load on the device's controller
    for the cell of that name; raises ValueError for errors in the address or the limits.
    `places(address)`: what the device occupies for itself, by `host_places` and `path_places`: two processes never use
    one place at once. Without it, the address's path, or its host and port.
    `firmware`: the folder with sources and program of a device that one builds oneself.
    """

    open: Callable[[str, Address, Surroundings], Device]
    abilities: type
    check_address: Callable[[Address, Path], list[str]] | None = None
    check_setup: Callable[[Address, Surroundings], list[Finding]] | None = None
    controller_files: Callable[[str, Address, Surroundings], dict[str, str]] | None = None
    places: Callable[[Address], Iterable[str]] | None = None
    firmware: Path | None = None
