"""Messages of the primary interface: programs, errors, the safety mode, texts; and the version, sent to every client.

All numbers are big-endian. A message: size (4), type 20, time (8, µs), source, kind, content.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import final

from sims.ur._script_expressions import ScriptError

ROBOT_MESSAGE = 20
TEXT, POPUP, VERSION, SAFETY_MODE, ERROR_CODE, KEY, RUNTIME_EXCEPTION = 0, 2, 3, 5, 6, 7, 10
"""Kinds of a message."""
ROBOT, URCONTROL, PROGRAM = -1, -3, -2
"""Sources: the arm, the controller's software, a program."""
VIOLATION_LEVEL = 3
"""Report level of an error that stops the arm."""
PROJECT = b"URControl"

Send = Callable[[bytes], object]


@final
class Messages:
    """Sends each message to every client of the primary interface. `clock`: the controller's, µs."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self.clients: list[Send] = []
        self.log: list[str] = []
        self._clock = clock

    def text(self, text: str) -> None:
        """`textmsg`."""
        self.log.append(text)
        del self.log[:-1000]
        self._send(PROGRAM, TEXT, text.encode())

    def key(self, title: str, text: str) -> None:
        """A program began or ended."""
        name = title.encode()
        self._send(PROGRAM, KEY, struct.pack(">iiB", 0, 0, len(name)) + name + text.encode())

    def error(self, code: int, argument: int, text: str) -> None:
        """C`code`A`argument`."""
        self._send(ROBOT, ERROR_CODE, struct.pack(">iiiIi", code, argument, VIOLATION_LEVEL, 0, 0) + text.encode())

    def exception(self, error: ScriptError) -> None:
        """A program cannot be compiled or go on."""
        self.log.append(f"{error.line}: {error.text}")
        self._send(PROGRAM, RUNTIME_EXCEPTION, struct.pack(">ii", error.line, 0) + error.text.encode())

    def safety(self, mode: int) -> None:
        """The safety mode has changed."""
        self._send(ROBOT, SAFETY_MODE, struct.pack(">iiBII", 0, 0, mode, 0, 0))

    def popup(self, title: str, text: str, *, warning: bool, error: bool, blocking: bool) -> None:
        """`popup` of a program."""
        head = struct.pack(">IB???B", 0, 0, warning, error, blocking, min(len(title.encode()), 255))
        self._send(PROGRAM, POPUP, head + title.encode()[:255] + text.encode())

    def version(self, version: tuple[int, int, int, int]) -> bytes:
        """What a new client is sent."""
        major, minor, bugfix, build = version
        body = bytes([len(PROJECT)]) + PROJECT + struct.pack(">BBii", major, minor, bugfix, build) + b"simulated"
        return self._message(URCONTROL, VERSION, body)

    def _send(self, source: int, kind: int, content: bytes) -> None:
        message = self._message(source, kind, content)
        for send in list(self.clients):
            send(message)

    def _message(self, source: int, kind: int, content: bytes) -> bytes:
        body = struct.pack(">BQbb", ROBOT_MESSAGE, self._clock(), source, kind) + content
        return struct.pack(">i", 4 + len(body)) + body
