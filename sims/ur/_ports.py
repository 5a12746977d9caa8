"""The controller's TCP ports, on a loopback address of its own, so that they have their usual numbers.

What a client does not read is dropped where it is a stream of states, as by the controller; answers wait.
"""

from __future__ import annotations

import ipaddress
import os
import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, final

from sims.faults import Faults
from sims.kernel import Event, Kernel
from sims.wires import Wire

DASHBOARD, PRIMARY, SECONDARY, REALTIME, RTDE = 29999, 30001, 30002, 30003, 30004
PORTS = (DASHBOARD, PRIMARY, SECONDARY, REALTIME, RTDE)
FIRST_ADDRESS = "127.83.0.1"
ADDRESSES = 60_000
"""From the first one on; the process's number tells where to begin."""
MOST_UNSENT = 1 << 20
AGAIN_NS = 1_000_000
"""After which what could not be sent is tried again."""


class Conversation(Protocol):
    """What a server does with one client."""

    def feed(self, data: bytes) -> bool:
        """Take bytes; False hangs up."""

    def ended(self) -> None:
        """The client has gone."""


@final
class HostsWire:
    """The device's wire: the bytes of the host's connections to all ports, together."""

    def __init__(self, wire: Wire) -> None:
        self._wire, self._open = wire, 0

    def opened(self) -> None:
        """One of them begins."""
        if not self._open:
            self._wire.opened()
        self._open += 1

    def closed(self) -> None:
        """One of them has ended."""
        self._open -= 1
        if not self._open:
            self._wire.cut()

    def read(self, count: int) -> None:
        """So many bytes of the host's."""
        self._wire.read(count)

    def wrote(self, count: int) -> None:
        """So many bytes for it."""
        self._wire.wrote(count)


@final
class Connection:
    """One client. `wire`: of the cell's host, the first client at a port; None of another one."""

    def __init__(self, port: Port, stream: socket.socket, wire: HostsWire | None) -> None:
        self._port, self._socket, self._wire = port, stream, wire
        self._unsent = bytearray()
        self._event: Event | None = None
        self._conversation: Conversation | None = None
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if wire:
            wire.opened()
        conversation = port.conversation(self)
        if self.open:
            self._conversation = conversation
            port.kernel.watch(stream, self.receive)
        else:  # it has gone before it could be greeted
            conversation.ended()

    @property
    def hosts(self) -> bool:
        """Whether it is the cell's host's."""
        return self._wire is not None

    @property
    def open(self) -> bool:
        """Whether the connection is open."""
        return self._socket.fileno() >= 0

    def receive(self) -> bool:
        """Take what can be read at once; whether that was anything."""
        data = b""
        with suppress(OSError):
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                return False
        understood = bool(data) and self._conversation is not None and self._conversation.feed(data)
        if self._wire and self.open:
            self._wire.read(len(data))
        if not understood:
            self.close()
        return self.open

    def send(self, data: bytes, *, state: bool = False) -> None:
        """Send; a `state` is dropped where an earlier one still waits."""
        if not self.open or (state and self._unsent):
            return
        self._unsent += data
        if len(self._unsent) > MOST_UNSENT:
            self.close()
            return
        if self._event is None:
            self._flush()

    def close(self) -> None:
        """Hang up."""
        if not self.open:
            return
        if self._event:
            self._event.cancel()
        self._port.kernel.unwatch(self._socket)
        self._socket.close()
        if self._wire:
            self._wire.closed()
        if self._conversation:
            self._conversation.ended()
        self._port.left(self)

    def _flush(self) -> None:
        self._event = None
        if not self.open or not self._unsent:
            return
        slow = self._port.faults.active("ur.slow")
        part = bytes(self._unsent[: slow.settings["bytes"]] if slow else self._unsent)
        try:
            sent = self._socket.send(part)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.close()
            return
        if self._wire:
            self._wire.wrote(sent)
        del self._unsent[:sent]
        if self._unsent:
            self._event = self._port.kernel.after(AGAIN_NS, self._flush)


@final
class Port:
    """Listens; `conversation` makes what a new client talks to."""

    def __init__(
        self,
        kernel: Kernel,
        faults: Faults,
        wire: HostsWire,
        listener: socket.socket,
        conversation: Callable[[Connection], Conversation],
    ) -> None:
        self.kernel, self.faults, self.conversation = kernel, faults, conversation
        self.connections: list[Connection] = []
        self._wire = wire
        self._place = listener.getsockname()
        self._listener = listener
        self.open(listener)

    def open(self, listener: socket.socket | None = None) -> None:
        """Take clients from now on."""
        self._listener = listener or socket.create_server(self._place)
        self._listener.setblocking(False)
        self.kernel.watch(self._listener, self._accept)

    def close(self) -> None:
        """Stop listening, and hang up on every client."""
        self.kernel.unwatch(self._listener)
        self._listener.close()
        for connection in list(self.connections):
            connection.close()

    def left(self, connection: Connection) -> None:
        """A client has gone."""
        with suppress(ValueError):
            self.connections.remove(connection)

    def _accept(self) -> None:
        while True:
            try:
                stream = self._listener.accept()[0]
            except OSError:
                return
            for connection in list(self.connections):
                while connection.receive():  # its end may be waiting to be read: then the wire is free
                    pass
            taken = any(connection.hosts for connection in self.connections)
            connection = Connection(self, stream, None if taken else self._wire)
            if connection.open:
                self.connections.append(connection)
                connection.receive()


def bound(host: str) -> tuple[str, list[socket.socket]]:
    """Listeners of all ports on `host`, where that is a loopback address of its own, else on a free one.

    Raises OSError.
    """
    own = host.startswith("127.") and host != "127.0.0.1"
    first = int(ipaddress.ip_address(FIRST_ADDRESS))
    places = [host] if own else [str(ipaddress.ip_address(first + (os.getpid() + i) % ADDRESSES)) for i in range(64)]
    for place in places:
        listeners: list[socket.socket] = []
        try:
            for port in PORTS:
                listeners.append(socket.create_server((place, port)))  # noqa: PERF401  # some are kept if one fails
        except OSError:
            for listener in listeners:
                listener.close()
            continue
        return place, listeners
    raise OSError(f"the ports {PORTS[0]} and {PORTS[1]} to {PORTS[-1]} are in use at {places[0]}, and wherever else")
