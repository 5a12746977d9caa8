"""What has gone over each device's wire, counted at this end, so that neither end runs ahead of the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import final


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
