"""Places of devices: what one of them occupies for itself, named alike however an address names it."""

from __future__ import annotations

import os
import socket
import stat
from ipaddress import IPv6Address, ip_address
from pathlib import Path

from cellctl.devices.addresses import Address


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
