"""The TCP end of a simulated device: several clients, of which the first is the cell's host."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, TypeAlias, final

from sims.kernel import Kernel
from sims.wires import Wire

MOST_CLIENTS = 8


class Conversation(Protocol):
    """What a device says to one client."""

    def feed(self, data: bytes) -> bool:
        """Take bytes of the client, none at its end; False hangs up, as they are no message."""


@final
class Client:
    """One connection. `wire`: counts its bytes if it is the cell's host, None for another client."""

    def __init__(self, kernel: Kernel, stream: socket.socket, server: TcpServer, wire: Wire | None) -> None:
        self.wire = wire
        self._kernel, self._socket, self._server = kernel, stream, server
        self._conversation = server.conversation(self)
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if wire:
            wire.opened()
        kernel.watch(stream, self.receive)

    @property
    def open(self) -> bool:
        """Whether the connection is open."""
        return self._socket.fileno() >= 0

    def receive(self) -> bool:
        """Take what can be read at once; whether that was anything. Hang up at its end, or where it is no message."""
        data = b""
        with suppress(ConnectionError):
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                return False
        understood = self._conversation.feed(data)
        if self.wire:
            self.wire.read(len(data))
        if not data or not understood:
            self.close()
        return self.open

    def send(self, data: bytes) -> None:
        """Send an answer; who does not read is hung up on."""
        if not self.open:
            return
        try:
            sent = self._socket.send(data)
        except OSError:
            sent = 0
        if self.wire:
            self.wire.wrote(sent)
        if sent < len(data):
            self.close()

    def close(self) -> None:
        """Hang up."""
        if not self.open:
            return
        self._kernel.unwatch(self._socket)
        self._socket.close()
        if self.wire:
            self.wire.cut()
        self._server.left(self)


Conversing: TypeAlias = Callable[[Client], Conversation]


@final
class TcpServer:
    """Listens on a free port of 127.0.0.1, `port`. The first client is the cell's host; the bytes of others are not
    counted. `conversation` makes what a new client talks to.
    """

    def __init__(self, kernel: Kernel, wire: Wire, conversation: Conversing) -> None:
        self.conversation = conversation
        self._kernel, self._wire = kernel, wire
        self._clients: list[Client] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self.listen()

    def listen(self) -> None:
        """Take clients from now on."""
        self._kernel.watch(self._listener, self._accept)

    def hang_up(self) -> None:
        """Close every connection; a new one finds nobody who answers."""
        self._kernel.unwatch(self._listener)
        for client in list(self._clients):
            client.close()
        self._wire.cut()

    def close(self) -> None:
        """Hang up on every client, and stop listening."""
        self.hang_up()
        self._listener.close()

    def left(self, client: Client) -> None:
        """A client has gone."""
        with suppress(ValueError):
            self._clients.remove(client)

    def _accept(self) -> None:
        """Take all who wait. What one has written is read at once: its host counts it from its connection on."""
        while stream := self._caller():
            for client in list(self._clients):
                while client.receive():  # its end may be waiting to be read: then the wire is free
                    pass
            if len(self._clients) == MOST_CLIENTS:
                stream.close()
                continue
            taken = any(client.wire for client in self._clients)
            client = Client(self._kernel, stream, self, None if taken else self._wire)
            self._clients.append(client)
            client.receive()

    def _caller(self) -> socket.socket | None:
        with suppress(OSError):
            return self._listener.accept()[0]
        return None
