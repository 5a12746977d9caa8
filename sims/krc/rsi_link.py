"""The controller's UDP end: it calls the PC from a port of its own, and in lockstep T waits for the answer."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import suppress
from typing import Any, final

from sims.kernel import Hold, Kernel
from sims.simulator import Refused

PEER = "rsi"
_RECEIVE = 65535


def target_of(message: dict[str, Any]) -> tuple[str, int]:
    """Host and port of an `rsi_target` message. Raises Refused."""
    host, port = message.get("host"), message.get("port")
    if not isinstance(host, str) or not isinstance(port, int) or not 0 < port < 0x10000:
        raise Refused("host and port are expected, as 127.0.0.1 and 49152")
    return host, port


@final
class RsiLink:
    """Sends telegrams to the target, passes its datagrams to `on_datagram`, and holds T from `send` to `answered`."""

    def __init__(self, kernel: Kernel) -> None:
        self.on_datagram: Callable[[bytes], object] = lambda data: None
        self._kernel = kernel
        self._socket: socket.socket | None = None
        self._hold: Hold | None = None
        self._target = ("", 0)
        self.sessions = 0
        """RSI_ON so far."""

    @property
    def has_target(self) -> bool:
        """Whether the controller has the PC's address."""
        return self._socket is not None

    def set_target(self, host: str, port: int) -> None:
        """The address of the PC (`<IP_NUMBER>` and `<PORT>` of its configuration)."""
        self.close()
        self._target = host, port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.connect((host, port))
        self._kernel.watch(self._socket, self._receive)

    def begin(self, *, new_port: bool) -> None:
        """RSI_ON, from the port of the session before, or from a new one."""
        self.sessions += 1
        if new_port and self._socket and self.sessions > 1:
            self.set_target(*self._target)

    def drain(self) -> None:
        """Throw away what has come so far: it belongs to an earlier RSI_ON."""
        callback, self.on_datagram = self.on_datagram, lambda data: None
        self._receive()
        self.on_datagram = callback

    def send(self, telegram: bytes, *, answer_within_ns: int | None) -> None:
        """One telegram; T stands still until `answered`, where an answer is awaited (in real time: for so long)."""
        if self._socket is None:
            return
        self.answered()
        try:
            self._socket.send(telegram)
        except ConnectionRefusedError:  # of an earlier telegram; this one has not left
            with suppress(BlockingIOError, ConnectionRefusedError):
                self._socket.send(telegram)
        if answer_within_ns is not None:
            self._hold = self._kernel.hold_for_answer(PEER, answer_within_ns)

    def answered(self) -> None:
        """The answer has come, or is no longer awaited."""
        if self._hold:
            self._hold.release()
            self._hold = None

    def alive(self) -> None:
        """The PC keeps step: T waits for it."""
        self._kernel.alive(PEER)

    def close(self) -> None:
        """Close the port."""
        self.answered()
        if self._socket:
            self._kernel.unwatch(self._socket)
            self._socket.close()
            self._socket = None

    def _receive(self) -> None:
        while self._socket is not None:
            try:
                data = self._socket.recv(_RECEIVE)
            except BlockingIOError:
                return
            except ConnectionRefusedError:  # no process is bound there: no answer will arrive
                self.answered()
                continue
            self.on_datagram(data)
