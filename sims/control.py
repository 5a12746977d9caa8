"""The control port: JSON lines over TCP, for the host's clock, for faults, and to end the cell.

Tick and tock keep the attached host and the cell in step (lockstep). A tick contains T and the number of bytes that the
simulators have written to each wire; the host answers when it has read them and has no work left at T. Its tock
contains the number of bytes it has written, and when its next timer is due; T continues when the simulators have read
those. A tick is sent before the next event if an event has written to a wire, and else 20 ms after the last tick, or
as many times 20 ms as it takes until that timer is due. So all interactions of host and cell happen at the same T in
every run, for any transmission delay.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Mapping
from typing import Any, final

from sims.faults import SEARCH, FaultError, Faults
from sims.kernel import FOR_EVER_NS, Event, Hold, Kernel
from sims.scene.safety import Safety
from sims.simulator import Refused, Request
from sims.wires import Wire

STRIDE_NS = 20_000_000
"""Ticks are sent at multiples of this after the last one."""
LONGEST_NS = 1_000_000_000
"""Largest advance of T past the attached host's last tock, wherever no timer of the host's is due."""

_LONGEST = 65_536


@final
class ControlPort:
    """Listens on a free port of the loopback.

    `requests`: device → `op` → what it does for its device; `safety`: the chain that `reset` closes; `wires`: device →
    what went over its wire.
    """

    def __init__(
        self,
        kernel: Kernel,
        faults: Faults,
        requests: Mapping[str, Mapping[str, Request]],
        safety: Safety,
        wires: dict[str, Wire] | None = None,
    ) -> None:
        self.kernel = kernel
        self.wires = wires or {}
        self.attached: Connection | None = None
        self._faults = faults
        self._requests, self._safety = requests, safety
        self._connections: set[Connection] = set()
        self._awaited: Hold | None = None
        kernel.before_event = self._keep_in_step
        for wire in self.wires.values():
            wire.on_read = self._wire_was_read
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        kernel.watch(self._listener, self._accept)

    @property
    def address(self) -> str:
        """Where it listens, `127.0.0.1:40124`."""
        host, port = self._listener.getsockname()
        return f"{host}:{port}"

    def wait_for_host(self) -> None:
        """Keep T at 0 until a host attaches (lockstep)."""
        self._awaited = self.kernel.hold("host", FOR_EVER_NS)

    def close(self) -> None:
        """Close all connections."""
        for connection in list(self._connections):
            connection.close()
        self.kernel.unwatch(self._listener)
        self._listener.close()

    def answer(self, connection: Connection, request: dict[str, Any]) -> dict[str, Any] | None:
        """Execute the request; returns None without an answer. Raises Refused."""
        match request:
            case {"tock": int(time_ns)}:
                connection.tocked(time_ns, _counts(request.get("wires", {})), _due(request.get("next", time_ns)))
                return None
            case {"next": int(due_ns)}:
                connection.timer_set(due_ns)
                return None
            case {"busy": int()}:
                connection.busy()
                return None
            case {"op": "attach"}:
                self._attach(connection, str(request.get("name", "host")))
                return None
            case {"op": "fault"}:
                self._fault({key: value for key, value in request.items() if key != "op"})
                return {"ok": True}
            case {"op": "status"}:
                return self._status()
            case {"op": "reset"}:
                self._reset()
                return {"ok": True}
            case {"op": "shutdown"}:
                self.kernel.stop()
                return {"ok": True}
            case {"op": str(op)}:
                self._ask_device(op, request)
                return {"ok": True}
        raise Refused(
            "what is asked is not understood; a message has an 'op', as attach, fault, reset, status or shutdown"
        )

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
        for wire in self.wires.values():
            wire.begin()
        connection.attach(name)
        if self._awaited is not None:
            self._awaited.release()

    def _keep_in_step(self) -> None:
        if self.attached is not None:
            self.attached.tick_after_output()

    def _wire_was_read(self) -> None:
        if self.attached is not None:
            self.attached.go_on_if_read()

    def _ask_device(self, op: str, request: dict[str, Any]) -> None:
        able = {device: requests[op] for device, requests in self._requests.items() if op in requests}
        ask = able.get(str(request.get("device")))
        if ask is None:
            raise Refused(
                f"there is no '{op}' of that device; devices that have it: {', '.join(able) or 'none'}; "
                "without a device: attach, fault, reset, status, shutdown"
            )
        ask(request)

    def _reset(self) -> None:
        """As somebody who goes there: release the emergency stop, close the guard, acknowledge every message."""
        self._safety.close_emergency_stop()
        self._safety.close_guard()
        for requests in self._requests.values():
            if acknowledge := requests.get("acknowledge"):
                acknowledge({})

    def _fault(self, entry: dict[str, Any]) -> None:
        try:
            self._faults.schedule(self._faults.catalogue.read(entry))
        except FaultError as error:
            raise Refused(str(error)) from None

    def _status(self) -> dict[str, Any]:
        kernel = self.kernel
        return {
            "ok": True,
            "time_ns": kernel.now,
            "mode": kernel.mode,
            "searches": self._faults.counts[SEARCH],
            "events": dict(self._faults.counts),
            "holds": kernel.holders(),
        }


@final
class Connection:
    """One connection to the control port. While attached, T waits for its tocks."""

    def __init__(self, port: ControlPort, stream: socket.socket) -> None:
        self.name = ""
        self._port = port
        self._kernel = port.kernel
        self._stream = stream
        self._begun = b""
        self._next_tick: Event | None = None
        self._due_ns = self._last_ns = 0
        self._ticked: int | None = None
        self._told: dict[str, int] = {}
        self._to_read: dict[str, int] | None = None
        self._hold: Hold | None = None
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        stream.setblocking(False)
        self._kernel.watch(stream, self._readable)

    @property
    def _peer(self) -> str:
        return f"host {self.name}"

    def attach(self, name: str) -> None:
        """From now on T waits for this host's tocks; the first tick is sent at once."""
        self.name = name
        self._send_tick()

    def tick_after_output(self) -> None:
        """Send a tick where a simulator has written to a wire since the last one.

        The kernel calls this when nothing holds T. If the host has answered and T still waited for its bytes, that
        wait was given up: they were lost. Without the next tick the host's timers would never fire again.
        """
        if self._to_read is not None:
            self._go_on()
        if self._told != self._written():
            self._send_tick()

    def tocked(self, time_ns: int, written: dict[str, int], due_ns: int) -> None:
        """The host has done all that is to be done at `time_ns`, and has written so many bytes to each wire.

        Its next timer is due at `due_ns`. An older tick's answer only shows that it is alive.
        """
        if self._ticked is None or time_ns != self._ticked:
            return
        self._to_read, self._due_ns = written, due_ns
        self.go_on_if_read()

    def go_on_if_read(self) -> None:
        """Let T continue once the host has answered and the simulators have read what it wrote."""
        if self._ticked is None or self._to_read is None:
            return
        wires = self._port.wires
        if not all(wires[name].has_read(count) for name, count in self._to_read.items() if name in wires):
            return
        self._go_on()

    def _go_on(self) -> None:
        assert self._ticked is not None
        self._last_ns, self._ticked, self._to_read = self._ticked, None, None
        if self._hold is not None:
            self._hold.release()
        self._schedule_tick()

    def timer_set(self, due_ns: int) -> None:
        """The host has set an earlier timer since its tock, because of something outside the cell."""
        self._due_ns = min(self._due_ns, due_ns)
        if self._ticked is None:
            self._schedule_tick()

    def _schedule_tick(self) -> None:
        if self._next_tick is not None:
            self._next_tick.cancel()
        until_ns = max(self._kernel.now, min(self._due_ns, self._last_ns + LONGEST_NS)) - self._last_ns
        strides = max(1, -(-until_ns // STRIDE_NS))
        self._next_tick = self._kernel.at(self._last_ns + strides * STRIDE_NS, self._send_tick)

    def busy(self) -> None:
        """The host is at work on the last tick."""
        if self._hold is not None:
            self._hold.extend()

    def close(self) -> None:
        """Close the connection; T no longer waits for it."""
        self._kernel.unwatch(self._stream)
        self._stream.close()
        if self._next_tick is not None:
            self._next_tick.cancel()
        if self.name:
            self._kernel.forget(self._peer)
        self._port.gone(self)

    def _send_tick(self) -> None:
        if self._next_tick is not None:
            self._next_tick.cancel()
        self._ticked, self._told, self._to_read = self._kernel.now, self._written(), None
        self._hold = self._kernel.hold(self._peer)
        self._send({"tick": self._ticked, "wires": self._told})

    def _written(self) -> dict[str, int]:
        return {name: wire.written for name, wire in self._port.wires.items()}

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


def _due(value: object) -> int:
    """When the host's next timer is due; null: it has none."""
    if value is not None and not isinstance(value, int):
        raise Refused("next is a time in nanoseconds, or null")
    return FOR_EVER_NS if value is None else value


def _counts(value: object) -> dict[str, int]:
    if not isinstance(value, dict) or not all(isinstance(count, int) for count in value.values()):
        raise Refused('wires is an object of whole numbers, as {"probe": 120}')
    return value
