"""The PLC's TCP end: several clients, each request answered after a delay of the cell's time."""

from __future__ import annotations

import random
import socket
from contextlib import suppress
from functools import partial
from typing import final

from sims.kernel import Kernel
from sims.plc.description import low_first, unit_of
from sims.plc.frames import Frame, FrameStream
from sims.plc.functions import NO_TARGET, answer, exception
from sims.plc.process import PlcProgram
from sims.simulator import Request, Setup, with_settings
from sims.wires import Wire

MOST_CLIENTS = 8


@final
class Client:
    """One connection. `wire`: counts its bytes if it is the cell's host, None for another client."""

    def __init__(self, kernel: Kernel, stream: socket.socket, server: PlcServer, wire: Wire | None) -> None:
        self.wire = wire
        self._kernel, self._socket, self._server = kernel, stream, server
        self._stream = FrameStream()
        self._free_ns = 0
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
        """Take what can be read at once; whether that was anything. Hang up at its end, or where it is no Modbus."""
        data = b""
        with suppress(ConnectionError):
            try:
                data = self._socket.recv(65536)
            except BlockingIOError:
                return False
        for frame in self._stream.feed(data):
            self._take(frame)
        if self.wire:
            self.wire.read(len(data))
        if not data or self._stream.broken:
            self.close()
        return self.open

    def close(self) -> None:
        """Hang up."""
        if not self.open:
            return
        self._kernel.unwatch(self._socket)
        self._socket.close()
        if self.wire:
            self.wire.cut()
        self._server.left(self)

    def _take(self, request: Frame) -> None:
        """Requests of one connection are done one after another, each after its own delay."""
        self._free_ns = max(self._free_ns, self._kernel.now) + self._server.delay_ns()
        self._kernel.at(self._free_ns, partial(self._do, request))

    def _do(self, request: Frame) -> None:
        if not self.open:
            return
        data = Frame(request.transaction, request.unit, self._server.answer(request)).encode()
        try:
            sent = self._socket.send(data)
        except OSError:
            sent = 0
        if self.wire:
            self.wire.wrote(sent)
        if sent < len(data):  # it does not read, or has gone
            self.close()


@final
class PlcServer:
    """Listens on a free port of 127.0.0.1. The first client is the cell's host; the bytes of others are not counted.

    Fault `plc.gone`: every connection is closed, and a new one finds nobody who answers.
    """

    def __init__(self, setup: Setup) -> None:
        settings, seed = setup.settings, setup.cell.simulate.seed
        self._kernel, self._wire, self._unit = setup.kernel, setup.wire, unit_of(setup.address)
        self._least_ns = round(settings["delay_least_ms"] * 1e6)
        self._most_ns = max(self._least_ns, round(settings["delay_most_ms"] * 1e6))
        self._draw = random.Random(f"{seed} plc delays")
        clamp_ns = round(settings["clamp_ms"] * 1e6)
        words = low_first(setup.address)
        self.program = PlcProgram(setup.kernel, setup.scene, setup.faults, seed, clamp_ns, low_first=words)
        self._clients: list[Client] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.port: int = self._listener.getsockname()[1]
        self.address = with_settings(setup.address, f"127.0.0.1:{self.port}")
        self.requests: dict[str, Request] = {}
        setup.faults.on_start("plc.gone", self._go)
        setup.faults.on_end("plc.gone", self._return)
        self._kernel.watch(self._listener, self._accept)

    def delay_ns(self) -> int:
        """Time from a request to its answer."""
        return self._draw.randint(self._least_ns, self._most_ns)

    def answer(self, request: Frame) -> bytes:
        """The answer's PDU. A unit that is not there is answered as by a gateway: 0B."""
        if request.unit != self._unit:
            return exception(request.pdu, NO_TARGET)
        return answer(request.pdu, self.program)

    def left(self, client: Client) -> None:
        """A client has gone."""
        with suppress(ValueError):
            self._clients.remove(client)

    def close(self) -> None:
        """Hang up on every client, and stop listening."""
        self._go()
        self._listener.close()

    def _go(self) -> None:
        self._kernel.unwatch(self._listener)
        for client in list(self._clients):
            client.close()
        self._wire.cut()

    def _return(self) -> None:
        self._kernel.watch(self._listener, self._accept)

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
