"""A TCP stream cut into XML documents: a document ends where its root element ends, however the bytes arrive."""

from __future__ import annotations

from collections.abc import Iterator
from typing import final

from sims.krc.xml_documents import LARGEST

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
