"""The controller on its ports: Dashboard, primary, secondary and real-time interface, RTDE."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import final
from urllib.parse import parse_qsl, urlencode, urlsplit

from sims.simulator import CannotStart, Refused, Setup
from sims.ur._controller import Controller
from sims.ur._dashboard import Dashboard
from sims.ur._functions import builtins_of
from sims.ur._kinematics import NotThisArm
from sims.ur._names import QUERY
from sims.ur._ports import (
    DASHBOARD,
    PORTS,
    PRIMARY,
    REALTIME,
    SECONDARY,
    Connection,
    Conversation,
    HostsWire,
    Port,
    bound,
)
from sims.ur._robot_state import STATE_NS, RobotState
from sims.ur._rtde import RtdeServer
from sims.ur._script_words import ScriptStream


@final
class ScriptClient:
    """A client of the primary, secondary or real-time interface: it sends programs, and gets states."""

    def __init__(self, servers: Servers, port: int, connection: Connection) -> None:
        self.connection, self.port = connection, port
        self._servers, self._stream = servers, ScriptStream()
        servers.joined(self)

    def feed(self, data: bytes) -> bool:
        """Take programs, in remote control."""
        for text in self._stream.feed(data):
            if self._servers.controller.remote:
                self._servers.controller.runtime.take(text)
        return True

    def ended(self) -> None:
        """No more states."""
        self._servers.left(self)


@final
class Servers:
    """Everything that listens. `address`: for the driver; `ports`: by their numbers."""

    def __init__(self, setup: Setup, controller: Controller) -> None:
        self.controller = controller
        controller.runtime.builtins = builtins_of(controller)
        self._kernel = setup.kernel
        self._state = RobotState(controller)
        self._clients: list[ScriptClient] = []
        self._streaming = False
        self.rtde = RtdeServer(controller)
        parts = urlsplit(setup.address)
        self.host, listeners = bound(parts.hostname or "")
        settings = {name: value for name, value in parse_qsl(parts.query) if name in QUERY}
        self.address = f"{parts.scheme}://{self.host}" + (f"?{urlencode(settings)}" if settings else "")
        self.requests = controller.requests
        wire = HostsWire(setup.wire)
        dashboard = Dashboard(controller)
        conversations: dict[int, Callable[[Connection], Conversation]] = {
            DASHBOARD: dashboard.conversation,
            PRIMARY: partial(ScriptClient, self, PRIMARY),
            SECONDARY: partial(ScriptClient, self, SECONDARY),
            REALTIME: partial(ScriptClient, self, REALTIME),
        }
        self.ports = {
            port: Port(setup.kernel, setup.faults, wire, listener, conversations.get(port, self.rtde.conversation))
            for port, listener in zip(PORTS, listeners, strict=True)
        }
        controller.on_cycle = self._cycle
        controller.on_reboot = self.close
        controller.on_booted = self._open
        controller.start_program()

    def close(self) -> None:
        """Hang up, and let go of the ports."""
        for port in self.ports.values():
            port.close()

    def joined(self, client: ScriptClient) -> None:
        """A client that gets states: the version first, then one state after the other."""
        self._clients.append(client)
        if client.port == REALTIME:
            self.controller.wake()
            return
        client.connection.send(self.controller.messages.version(self.controller.version))
        if client.port == PRIMARY:
            self.controller.messages.clients.append(client.connection.send)
        if not self._streaming:
            self._streaming = True
            self._kernel.after(0, self._states)

    def left(self, client: ScriptClient) -> None:
        """It is gone."""
        self._clients.remove(client)
        if client.port == PRIMARY:
            self.controller.messages.clients.remove(client.connection.send)

    def _open(self) -> None:
        for port in self.ports.values():
            port.open()

    def _states(self) -> None:
        clients = [client for client in self._clients if client.port != REALTIME]
        self._streaming = bool(clients)
        if clients:
            message = self._state.message()
            for client in clients:
                client.connection.send(message, state=True)
            self._kernel.after(STATE_NS, self._states)

    def _cycle(self, number: int) -> bool:
        """The beginning of a cycle; whether somebody waits for the next."""
        awaited = self.rtde.cycle(number)
        clients = [client for client in self._clients if client.port == REALTIME]
        if clients:
            package = self._state.realtime()
            for client in clients:
                client.connection.send(package, state=True)
        return awaited or bool(clients)


def start(setup: Setup) -> Servers:
    """Start the controller of the scene's arm. Raises CannotStart."""
    try:
        return Servers(setup, Controller(setup))
    except (NotThisArm, OSError, Refused) as error:
        raise CannotStart(str(error)) from None
