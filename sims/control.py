"""The control port: JSON lines over TCP, for the host's clock, for faults, and to end the cell."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from typing import Any, final

from sims.faults import FaultError, Faults, read_fault
from sims.kernel import Event, Hold, Kernel

STRIDE_NS = 20_000_000
"""How far T may go past the attached host's last tock."""

_LONGEST = 65_536

RsiTarget = Callable[[str, int], object]
"""Tells a robot's controller where its RSI telegrams go: host, port."""


class Refused(Exception):
    """A request that cannot be done; the text says why."""


@final
class ControlPort:
    """Listens on a free port of the loopback. `rsi_targets`: device → where to say its host and port."""

    def __init__(self, kernel: Kernel, faults: Faults, rsi_targets: dict[str, RsiTarget]) -> None:
        self.kernel = kernel
        self.attached: Connection | None = None
        self._faults = faults
        self._rsi_targets = rsi_targets
        self._connections: set[Connection] = set()
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        kernel.watch(self._listener, self._accept)

    @property
    def address(self) -> str:
        """Where it listens, `127.0.0.1:40124`."""
        host, port = self._listener.getsockname()
        return f"{host}:{port}"

    def close(self) -> None:
        """Hang up on everybody."""
        for connection in list(self._connections):
            connection.close()
        self.kernel.unwatch(self._listener)
        self._listener.close()

    def answer(self, connection: Connection, request: dict[str, Any]) -> dict[str, Any] | None:
        """Do what is asked; None where nothing is to be said. Raises Refused."""
        match request:
            case {"tock": int(time_ns)}:
                connection.tocked(time_ns)
                return None
            case {"op": "attach"}:
                self._attach(connection, str(request.get("name", "host")))
                return None
            case {"op": "rsi_target"}:
                self._set_rsi_target(request)
                return {"ok": True}
            case {"op": "fault"}:
                self._fault({key: value for key, value in request.items() if key != "op"})
                return {"ok": True}
            case {"op": "status"}:
                return self._status()
            case {"op": "shutdown"}:
                self.kernel.stop()
                return {"ok": True}
        raise Refused("what is asked is not understood; op is attach, rsi_target, fault, status or shutdown")

    def gone(self, connection: Connection) -> None:
        """A connection has ended."""
        self._connections.discard(connection)
        if self.attached is connection:
            self.attached = None

    def _accept(self) -> None:
        try:
            stream, _ = self._listener.accept()
        except OSError:
            return
        self._connections.add(Connection(self, stream))

    def _attach(self, connection: Connection, name: str) -> None:
        if self.kernel.mode != "lockstep":
            raise Refused("this cell runs in real time: nothing to attach to")
        if self.attached is not None:
            raise Refused(f"'{self.attached.name}' is attached already")
        self.attached = connection
        connection.attach(name)

    def _set_rsi_target(self, request: dict[str, Any]) -> None:
        target = self._rsi_targets.get(str(request.get("device")))
        if target is None:
            raise Refused(f"no device of that name takes RSI; there are {', '.join(self._rsi_targets) or 'none'}")
        host, port = request.get("host"), request.get("port")
        if not isinstance(host, str) or not isinstance(port, int) or not 0 < port < 0x10000:
            raise Refused("host and port are expected, as 127.0.0.1 and 49152")
        target(host, port)

    def _fault(self, entry: dict[str, Any]) -> None:
        try:
            self._faults.schedule(read_fault(entry))
        except FaultError as error:
            raise Refused(str(error)) from None

    def _status(self) -> dict[str, Any]:
        kernel = self.kernel
        return {
            "ok": True,
            "time_ns": kernel.now,
            "mode": kernel.mode,
            "searches": self._faults.searches,
            "holds": kernel.holders(),
        }


@final
class Connection:
    """One connection to the control port. While attached, T goes at most STRIDE_NS past its last tock."""

    def __init__(self, port: ControlPort, stream: socket.socket) -> None:
        self.name = ""
        self._port = port
        self._kernel = port.kernel
        self._stream = stream
        self._begun = b""
        self._tick: Event | None = None
        self._ticked: int | None = None
        self._hold: Hold | None = None
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        stream.setblocking(False)
        self._kernel.watch(stream, self._readable)

    @property
    def _peer(self) -> str:
        return f"host {self.name}"

    def attach(self, name: str) -> None:
        """From now on T waits for this host's tocks."""
        self.name = name
        self._tick = self._kernel.after(STRIDE_NS, self._send_tick)

    def tocked(self, time_ns: int) -> None:
        """The host has done what was due at `time_ns`: T may go on. An older tick's answer says only that it lives."""
        if self._ticked is None or time_ns != self._ticked:
            return
        self._ticked = None
        if self._hold is not None:
            self._hold.release()
        self._tick = self._kernel.at(time_ns + STRIDE_NS, self._send_tick)

    def close(self) -> None:
        """Hang up; T waits for it no more."""
        self._kernel.unwatch(self._stream)
        self._stream.close()
        if self._tick is not None:
            self._tick.cancel()
        if self.name:
            self._kernel.forget(self._peer)
        self._port.gone(self)

    def _send_tick(self) -> None:
        self._ticked = self._kernel.now
        self._hold = self._kernel.hold(self._peer)
        self._send({"tick": self._ticked})

    def _send(self, message: dict[str, Any]) -> None:
        data = json.dumps(message).encode() + b"\n"
        try:
            whole = self._stream.send(data) == len(data)
        except OSError:
            whole = False
        if not whole:  # gone, or it has not read for so long that the answers fill the line
            self.close()

    def _readable(self) -> None:
        try:
            data = self._stream.recv(_LONGEST)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data or len(self._begun) > _LONGEST:
            self.close()
            return
        if self.name:
            self._kernel.alive(self._peer)
        *lines, self._begun = (self._begun + data).split(b"\n")
        for line in lines:
            self._take(line)

    def _take(self, line: bytes) -> None:
        try:
            request = json.loads(line)
            answer = self._port.answer(self, request if isinstance(request, dict) else {})
        except (ValueError, RecursionError):
            answer = {"ok": False, "error": "a line is one JSON object"}
        except Refused as error:
            answer = {"ok": False, "error": str(error)}
        if answer is not None and self._stream.fileno() >= 0:
            self._send(answer)
