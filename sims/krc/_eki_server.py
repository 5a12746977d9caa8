"""The controller's TCP end of the transfer channel: one PC at a time; the stream is cut into XML documents."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import final

from sims.kernel import Event, Kernel
from sims.krc._program import Program
from sims.krc._xml_documents import LARGEST
from sims.wires import Wire

_OPEN, _CLOSE = b"<"[0], b">"[0]
_QUOTES = b"\"'"
_SPACE = b" \t\r\n"
_CLOSED_BY = ((b"<!--", b"-->", 7), (b"<![CDATA[", b"]]>", 12), (b"<?", b"?>", 4))
"""Mark-up that may hold `>` and quotes: how it begins, how it ends, its least length."""


@final
class DocumentStream:
    """Feed it bytes as they come, take documents out.

    What cannot become a document (stray text, an end without a beginning) comes out as it is, so that it is answered
    as unreadable, and the stream goes on behind it. One byte at a time, so that it cannot matter how TCP splits them.
    A document over 8 KiB ends the stream: its beginning comes out, the rest is thrown away unread, and `overlong` says
    that the connection is of no more use.
    """

    def __init__(self) -> None:
        self.overlong = False
        self._begin()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The documents that `data` completes."""
        for byte in () if self.overlong else data:
            if byte == _OPEN and self._broken_off_by_tag():
                yield self._take()
            self._document.append(byte)
            if self._completed_by(byte):
                yield self._take()
            if len(self._document) > LARGEST:
                self.overlong = True
                yield self._take()
                return

    def _begin(self) -> None:
        self._document = bytearray()
        self._tag = bytearray()
        self._quote = 0
        self._depth = 0
        self._stray = False

    def _take(self) -> bytes:
        document = bytes(self._document)
        self._begin()
        return document

    def _broken_off_by_tag(self) -> bool:
        """Whether a `<` here says that what came before it will never be a document."""
        inside_tag = bool(self._tag) and not self._quote and not self._shielded()
        return inside_tag or (self._stray and not self._tag)

    def _completed_by(self, byte: int) -> bool:
        if self._tag:
            self._tag.append(byte)
            return self._tag_ended(byte) and self._turned()
        if byte == _OPEN:
            self._tag.append(byte)
        elif self._depth == 0 and byte not in _SPACE:
            self._stray = True
        elif len(self._document) == 1 and self._depth == 0:
            self._document.clear()  # white space between documents
        return False

    def _shielded(self) -> tuple[bytes, int] | None:
        """How the present mark-up ends, where it is of the kind that may hold anything."""
        for begin, end, least in _CLOSED_BY:
            if self._tag.startswith(begin):
                return end, least
        return None

    def _tag_ended(self, byte: int) -> bool:
        shield = self._shielded()
        if shield:
            return len(self._tag) >= shield[1] and self._tag.endswith(shield[0])
        if self._quote:
            self._quote = 0 if byte == self._quote else self._quote
        elif byte in _QUOTES:
            self._quote = byte
        else:
            return byte == _CLOSE
        return False

    def _turned(self) -> bool:
        """Follow the depth of elements at a tag's end; True where the document ends here."""
        tag, self._tag = self._tag, bytearray()
        if tag.startswith((b"<!", b"<?")):
            return False
        if tag.startswith(b"</"):
            self._depth -= 1
        elif not tag.endswith(b"/>"):
            self._depth += 1
        return self._depth <= 0


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
