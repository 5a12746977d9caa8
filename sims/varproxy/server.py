"""The proxy's TCP end: several clients, all requests done one after another, each after a delay of the cell's time."""

from __future__ import annotations

import random
import socket
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import final

from sims.faults import Faults
from sims.kernel import Kernel
from sims.simulator import Setup
from sims.varproxy.files import FileDesk
from sims.varproxy.frames import Request, RequestStream
from sims.wires import Wire

MOST_CLIENTS = 8

Answering = Callable[[Request, FileDesk], bytes]


@final
class Client:
    """One connection. `wire`: counts its bytes if it is the cell's host, None for another client."""

    def __init__(self, stream: socket.socket, server: ProxyServer, wire: Wire | None, files: FileDesk) -> None:
        self.wire, self.files = wire, files
        self._socket, self._server, self._stream = stream, server, RequestStream()
        stream.setblocking(False)
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        if wire:
            wire.opened()
        server.kernel.watch(stream, self.receive)

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
        for request in self._stream.feed(data):
            self._server.take(request, self)
        if self.wire:
            self.wire.read(len(data))
        if not data or self._stream.broken:
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
        self._server.kernel.unwatch(self._socket)
        self._socket.close()
        if self.wire:
            self.wire.cut()
        self._server.left(self)


@final
class ProxyServer:
    """Listens on a free port of 127.0.0.1, `port`. The first client is the cell's host; others are not counted."""

    def __init__(self, setup: Setup, answering: Answering, files: dict[str, bytes]) -> None:
        settings = setup.settings
        self.kernel: Kernel = setup.kernel
        self._wire, self._faults = setup.wire, setup.faults
        self._answering, self._files = answering, files
        self._least_ns = round(settings["delay_least_ms"] * 1e6)
        self._most_ns = max(self._least_ns, round(settings["delay_most_ms"] * 1e6))
        self._draw = random.Random(f"{setup.cell.simulate.seed} varproxy delays")
        self._free_ns = 0
        self._cut = False
        self._clients: list[Client] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self._subscribe(setup.faults)
        self.kernel.watch(self._listener, self._accept)

    def take(self, request: Request, client: Client) -> None:
        """CrossComm does one request after the other, whoever asks."""
        delay = self._draw.randint(self._least_ns, self._most_ns)
        if slow := self._faults.active("varproxy.slow"):
            delay += round(slow.settings["delay_ms"] * 1e6)
        self._free_ns = max(self._free_ns, self.kernel.now) + delay
        self.kernel.at(self._free_ns, partial(self._do, request, client))

    def left(self, client: Client) -> None:
        """A client has gone."""
        with suppress(ValueError):
            self._clients.remove(client)

    def close(self) -> None:
        """Hang up on every client, and stop listening."""
        self._go()
        self._listener.close()

    def _subscribe(self, faults: Faults) -> None:
        faults.on_start("varproxy.gone", self._go)
        faults.on_end("varproxy.gone", self._return)
        faults.on_start("varproxy.cut", self._cut_next)

    def _do(self, request: Request, client: Client) -> None:
        if not client.open:
            return
        data = self._answering(request, client.files)
        if self._faults.active("varproxy.wrong_id"):
            data = ((request.number + 1) % 65536).to_bytes(2, "big") + data[2:]
        if self._faults.active("varproxy.garbage"):
            data = b"\x00\x01\x00\x00 no message"
        if self._cut:
            self._cut = False
            client.send(data[: len(data) // 2])
            client.close()
            return
        client.send(data)

    def _cut_next(self) -> None:
        self._cut = True

    def _go(self) -> None:
        self.kernel.unwatch(self._listener)
        for client in list(self._clients):
            client.close()
        self._wire.cut()

    def _return(self) -> None:
        self.kernel.watch(self._listener, self._accept)

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
            client = Client(stream, self, None if taken else self._wire, FileDesk(self._files))
            self._clients.append(client)
            client.receive()

    def _caller(self) -> socket.socket | None:
        with suppress(OSError):
            return self._listener.accept()[0]
        return None
