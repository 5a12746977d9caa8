"""The simulated devices' ends of their wires: TCP server, pseudo-terminal, count of what has gone over.

The terminal never blocks, and notices when the host hangs up.
"""

from __future__ import annotations

import fcntl
import os
import socket
import struct
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from typing import Protocol, TypeAlias, final

from sims.kernel import Kernel


@final
class Wire:
    """Bytes on the wire between one simulated device and the host.

    `written`: by the simulator since `begin`. What the host has written is awaited by its own count (`has_read`), as
    long as the wire has not been cut at this end.
    """

    def __init__(self) -> None:
        self.written = 0
        self.on_read: Callable[[], object] = lambda: None
        self._read = 0
        self._cut = False

    def begin(self) -> None:
        """A host attaches: it counts from here what is written to it. It may have called, and written, already."""
        self.written = 0

    def opened(self) -> None:
        """A host has called: what it writes is counted from here."""
        self._read, self._cut = 0, False

    def cut(self) -> None:
        """Hung up, by either side: what the host wrote and this end has not read is lost."""
        self._read, self._cut = 0, True
        self.on_read()

    def wrote(self, count: int) -> None:
        """Add this number of bytes passed to the operating system for the host."""
        self.written += count

    def read(self, count: int) -> None:
        """So many bytes of the host's were read, and what they ask for was done or scheduled."""
        self._read += count
        self.on_read()

    def has_read(self, count: int) -> bool:
        """Whether all `count` bytes that the host has written since it called have been read."""
        return self._cut or self._read >= count


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


_UNREAD = 1000
"""Number of unread characters that shows, without a known host, that no process reads."""


BITS_PER_CHARACTER = 10
"""8N1."""


def wire_time_ns(characters: int, baud: int) -> int:
    """How long so many characters take."""
    return characters * BITS_PER_CHARACTER * 1_000_000_000 // baud


@final
class Terminal:
    """A raw pseudo-terminal; hosts open `path`.

    Until a host has spoken the simulator keeps the host's end open itself: without any host, the operating system
    reports a hang-up without end. After that it lets go, so that the host's own hang-up can be seen.
    """

    def __init__(self, kernel: Kernel, on_bytes: Callable[[bytes], object], on_hang_up: Callable[[], object]) -> None:
        self._kernel = kernel
        self._on_bytes = on_bytes
        self._on_hang_up = on_hang_up
        self._ours, theirs = os.openpty()
        tty.setraw(theirs)
        os.set_blocking(self._ours, False)
        self._theirs: int | None = theirs
        self.path = os.ttyname(theirs)
        kernel.watch(self._ours, self._readable)

    def write(self, data: bytes) -> bool:
        """Give `data` to the host. False if it was lost, because no process reads."""
        self._forget_unread()
        try:
            return os.write(self._ours, data) == len(data)
        except OSError:
            return False

    def close(self) -> None:
        """Hang up on the host."""
        self._kernel.unwatch(self._ours)
        os.close(self._ours)
        self._let_go()

    def _readable(self) -> None:
        try:
            data = os.read(self._ours, 4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._let_go()
            self._on_bytes(data)
        else:
            self._keep_open()
            self._on_hang_up()

    def _keep_open(self) -> None:
        if self._theirs is None:
            self._theirs = os.open(self.path, os.O_RDWR | os.O_NOCTTY)
            termios.tcflush(self._theirs, termios.TCIFLUSH)

    def _forget_unread(self) -> None:
        """What a port that nobody has open receives is lost; a host to come finds no heap of old and torn lines."""
        if self._theirs is None:
            return
        (unread,) = struct.unpack("i", fcntl.ioctl(self._theirs, termios.FIONREAD, bytes(4)))
        if unread > _UNREAD:
            termios.tcflush(self._theirs, termios.TCIFLUSH)

    def _let_go(self) -> None:
        if self._theirs is not None:
            with suppress(OSError):
                os.close(self._theirs)
            self._theirs = None
