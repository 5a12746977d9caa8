"""The UDP line that accepts only the controller: bound exclusively; other senders are counted and dropped."""

from __future__ import annotations

import ctypes
import ipaddress
import socket
import struct
from contextlib import suppress
from typing import Any, Self, final

Place = Any
"""The sender of a datagram, as the socket reports it: (host, port, …)."""

_LARGEST_DATAGRAM = 65535

_MOST_AT_ONCE = 512
"""Datagrams read at once. A stall of 2 s leaves this many telegrams; a flood must not delay the newest answer."""

_BUFFER = 1 << 20
"""Bytes that the kernel buffers, if it grants this size: 2 s of telegrams of any content."""

_UNFILTERED = 16
"""Number of foreign datagrams that are read to name their sender; then the kernel drops them."""

_SO_ATTACH_FILTER = 26
_SO_MEMINFO = 55
_MEMINFO = struct.Struct("=9I")
"""The ninth counts the datagrams that the kernel dropped."""
_SOURCE_ADDRESS = 0xFFF00000 + 12
"""Of the IPv4 header, to a socket filter (SKF_NET_OFF)."""


@final
class ControllerLine:
    """A non-blocking socket that accepts the host `controller` (an address as `recvfrom` writes it).

    `foreign`: datagrams from other senders, with those that the kernel dropped; `last_foreign`: the sender of
    the last one that was read.
    """

    def __init__(self, line: socket.socket, controller: str) -> None:
        self.last_foreign: tuple[str, int] | None = None
        self._line = line
        self._controller = controller
        self._seen_foreign = 0
        self._filtered = False

    @classmethod
    def bind(cls, host: str, port: int, controller: str) -> Self:
        """Bound exclusively: with SO_REUSEADDR another program could silently take the telegrams. Raises OSError."""
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        flags = socket.AI_V4MAPPED if family == socket.AF_INET6 else 0
        heard = socket.getaddrinfo(controller, 0, family, socket.SOCK_DGRAM, flags=flags)[0][4][0]
        line = socket.socket(family, kind, protocol)
        line.setblocking(False)
        line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        line.bind(place)
        return cls(line, str(heard))

    def fileno(self) -> int:
        """The socket's descriptor, to wait for."""
        return self._line.fileno()

    @property
    def place(self) -> tuple[str, int]:
        """Host and port bound."""
        host, port = self._line.getsockname()[:2]
        return host, port

    @property
    def foreign(self) -> int:
        """Datagrams that did not come from the controller."""
        return self._seen_foreign + self._dropped()

    def receive(self) -> list[tuple[bytes, Place]]:
        """The waiting datagrams of the controller, in the order of arrival, with their senders; limited in number."""
        heard = []
        for _ in range(_MOST_AT_ONCE):
            try:
                datagram, sender = self._line.recvfrom(_LARGEST_DATAGRAM)
            except BlockingIOError:
                break
            if sender[0] == self._controller:
                heard.append((datagram, sender))
            else:
                self.count_foreign(sender)
        return heard

    def count_foreign(self, sender: Place) -> None:
        """A datagram came from a sender that is not, or no longer, the controller's RSI."""
        self.last_foreign = sender[0], sender[1]
        self._seen_foreign += 1
        if self._seen_foreign == _UNFILTERED:
            with suppress(OSError, ValueError):  # other kernels, or IPv6: foreign datagrams are still dropped here
                self._attach_filter()

    def send(self, reply: bytes, place: Place) -> None:
        """Send. Raises OSError."""
        self._line.sendto(reply, place)

    def close(self) -> None:
        """Close the port."""
        self._line.close()

    def _attach_filter(self) -> None:
        """A classic BPF program: pass datagrams from the controller's IPv4 address, drop the rest."""
        address = int(ipaddress.IPv4Address(self._controller))
        program = ((0x20, 0, 0, _SOURCE_ADDRESS), (0x15, 0, 1, address), (0x06, 0, 0, 0xFFFFFFFF), (0x06, 0, 0, 0))
        code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *instruction) for instruction in program))
        pointer = struct.pack("@HP", len(program), ctypes.addressof(code))
        self._line.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, pointer)
        self._filtered = True

    def _dropped(self) -> int:
        if not self._filtered:
            return 0
        figures = self._line.getsockopt(socket.SOL_SOCKET, _SO_MEMINFO, _MEMINFO.size)
        return int(_MEMINFO.unpack(figures)[-1])
