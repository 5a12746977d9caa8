"""A serial line: a pseudo-terminal in the place of the adapter, and the time that characters take.

The terminal never blocks, and notices when the host hangs up.
"""

from __future__ import annotations

import fcntl
import os
import struct
import termios
import tty
from collections.abc import Callable
from contextlib import suppress
from typing import final

from sims.kernel import Kernel

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
