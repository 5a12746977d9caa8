"""The controller's TCP end of the transfer channel: one PC at a time, documents in, documents out."""

from __future__ import annotations

import socket
from contextlib import suppress
from functools import partial
from typing import final

from sims.kernel import Event, Kernel
from sims.krc.eki_stream import DocumentStream
from sims.krc.program import Program
from sims.wires import Wire

STATE_EVERY_NS = 100_000_000
TAKEN_AFTER_NS = 4_000_000
"""A command waits for the submit interpreter's next round of its loop. HALT interrupts it, unless another waits."""
UNREAD = 65_536
"""Bytes that TCP keeps for a PC that does not read: few, so that what it reads next is not minutes old."""
MOST_UNSENT = 262_144
RESTART_NS = 2_000_000_000


@final
class EkiServer:
    """Listens on a free port of 127.0.0.1, `port`; passes documents to the program."""

    def __init__(self, kernel: Kernel, program: Program, wire: Wire) -> None:
        self._kernel = kernel
        self._wire = wire
        self._program = program
        self._listener = _bound(0)
        self.port: int = self._listener.getsockname()[1]
        self._peer: socket.socket | None = None
        self._stream = DocumentStream()
        self._unsent = bytearray()
        self._waiting = 0
        self._timer: Event | None = None
        self._restarted: Event | None = None
        self._listen()

    def close(self) -> None:
        """Stop listening and hang up; in this order, or who is hung up on could be back before."""
        self._kernel.unwatch(self._listener)
        self._listener.close()
        self._hang_up()

    def restart(self) -> None:
        """Hang up; who calls in the next 2 s is refused. The port stays the same."""
        self.close()
        if self._restarted:
            self._restarted.cancel()
        self._listener = _bound(self.port)
        self._restarted = self._kernel.after(RESTART_NS, self._listen)

    def _listen(self) -> None:
        self._listener.listen(4)
        self._kernel.watch(self._listener, self._accept)

    def _accept(self) -> None:
        with suppress(BlockingIOError):
            peer, _ = self._listener.accept()
            while self._receive():  # its end may be waiting to be read: then the line is free
                pass
            if self._peer:
                peer.close()
                return
            self._welcome(peer)

    def _welcome(self, peer: socket.socket) -> None:
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, UNREAD)
        self._peer, self._stream = peer, DocumentStream()
        self._wire.opened()
        self._unsent.clear()
        self._kernel.watch(peer, self._receive)
        self._program.connected(self._send)
        self._timer = self._kernel.after(STATE_EVERY_NS, self._tell)

    def _receive(self) -> bool:
        """Take what can be read at once; whether that was anything."""
        if not self._peer:
            return False
        try:
            data = self._peer.recv(65536)
        except BlockingIOError:
            return False
        except ConnectionError:
            data = b""
        if not data:
            self._hang_up()
            return False
        for document in self._stream.feed(data):
            self._take(document, self._peer)
        if self._stream.overlong:
            self._kernel.unwatch(self._peer)
            self._kernel.after(TAKEN_AFTER_NS, self._hang_up_next)
        self._wire.read(len(data))
        return not self._stream.overlong

    def _take(self, document: bytes, sender: socket.socket) -> None:
        self._waiting += 1
        if self._waiting == 1 and b'Op="HALT"' in document:
            self._execute(document, sender)
        else:
            self._kernel.after(TAKEN_AFTER_NS, partial(self._execute, document, sender))

    def _execute(self, document: bytes, sender: socket.socket) -> None:
        self._waiting -= 1
        if self._peer is sender:
            self._program.execute(document)

    def _tell(self) -> None:
        self._flush()
        if not self._unsent:  # a client that does not read gets the next state, not every one since
            self._program.send_state()
        if self._peer:
            self._timer = self._kernel.after(STATE_EVERY_NS, self._tell)

    def _send(self, document: bytes) -> None:
        """Never blocks: what TCP does not take waits, and a client that does not read for long counts as lost."""
        self._unsent += document
        self._flush()

    def _flush(self) -> None:
        try:
            while self._peer and self._unsent:
                sent = self._peer.send(self._unsent)
                del self._unsent[:sent]
                self._wire.wrote(sent)
        except BlockingIOError:
            if len(self._unsent) > MOST_UNSENT:
                self._hang_up_next()
        except ConnectionError:
            self._hang_up_next()

    def _hang_up_next(self) -> None:
        """Once what is being done is done: on this PC, not on one that has called in its place by then."""
        lost = self._peer
        self._kernel.at(self._kernel.now, lambda: self._hang_up() if self._peer is lost else None)

    def _hang_up(self) -> None:
        if self._timer:
            self._timer.cancel()
        if self._peer:
            self._kernel.unwatch(self._peer)
            self._peer.close()
            self._peer = None
            self._wire.cut()
            self._program.disconnected()


def _bound(port: int) -> socket.socket:
    """A socket with a port of 127.0.0.1 (0: a free one) that does not listen yet."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    bound.setblocking(False)
    bound.bind(("127.0.0.1", port))
    return bound
