"""Host → instrument: characters one after another, cut into requests."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import final

from sims.geocom.lines import LONGEST
from sims.kernel import Kernel
from sims.terminal import wire_time_ns

LF, CR, ABORT = 0x0A, 0x0D, ord("c")


@final
class Receiver:
    """Each is called when the last of its characters has come over the line.

    line: a request without its end. clear: a line feed that ends no line: what waits is to be forgotten. abort: the
    single character `c`. overrun: the end of a line that was longer than the buffer.
    """

    def __init__(
        self,
        kernel: Kernel,
        baud: int,
        *,
        line: Callable[[bytes], object],
        clear: Callable[[], object],
        abort: Callable[[], object],
        overrun: Callable[[], object],
    ) -> None:
        self._kernel = kernel
        self._baud = baud
        self._line, self._clear, self._abort, self._overrun = line, clear, abort, overrun
        self._begun = bytearray()
        self._too_long = False
        self._free_at = 0

    def feed(self, chunk: bytes) -> None:
        """Characters that the host has put into its adapter now."""
        start = max(self._free_at, self._kernel.now)
        self._free_at = start + wire_time_ns(len(chunk), self._baud)
        for count, character in enumerate(chunk, 1):
            action = self._take(character)
            if action is not None:
                self._kernel.at(start + wire_time_ns(count, self._baud), action)

    def forget(self) -> None:
        """A line that has begun is forgotten."""
        self._begun.clear()
        self._too_long = False

    def _take(self, character: int) -> Callable[[], object] | None:
        if character == LF:
            return self._end()
        if character == ABORT and not self._begun:
            return self._abort
        if len(self._begun) < LONGEST:
            self._begun.append(character)
        else:
            self._too_long = True
            self._begun[-1] = character  # the line's end is still to be seen
        return None

    def _end(self) -> Callable[[], object]:
        line, too_long = bytes(self._begun), self._too_long
        self.forget()
        if not line.endswith(b"\r"):
            return self._clear
        return self._overrun if too_long else partial(self._line, line[:-1])
