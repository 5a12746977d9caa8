"""The simulated proxy on its own port; the test is a client that writes its bytes by hand, and lets time pass."""

from __future__ import annotations

import select
import socket
import time
from dataclasses import replace
from pathlib import Path

import pytest
from simulated_devices import catalogue, read_fault, setup_of

from sims.cell import read_cell
from sims.faults import Faults
from sims.kernel import Kernel
from sims.memory import Memory
from sims.varproxy.controller import start

SHIPPED = read_cell(Path(__file__).parents[3] / "procedures/cells/varproxy_cell.yaml")
PATIENCE_S = 60.0
MOST_TURNS = 200_000


class Bench:
    """The simulated proxy, and one client."""

    def __init__(self, memory=None, **settings):
        varproxy = {**SHIPPED.simulate.settings["varproxy"], **settings}
        simulate = replace(SHIPPED.simulate, settings={**SHIPPED.simulate.settings, "varproxy": varproxy})
        self.kernel = Kernel("lockstep")
        self.faults = Faults(self.kernel, catalogue())
        setup = setup_of(
            replace(SHIPPED, simulate=simulate), "robot", self.kernel, self.faults, memory=memory or Memory()
        )
        self.scene, self.wire, self.memory = setup.scene, setup.wire, setup.memory
        self.controller = start(setup)
        self.clients = []
        self.client = self.call()
        self.number = 0

    def call(self):
        place = ("127.0.0.1", self.controller.server.port)
        self.clients.append(socket.create_connection(place, timeout=PATIENCE_S))
        return self.clients[-1]

    def close(self):
        self.controller.close()
        self.kernel.close()
        for client in self.clients:
            client.close()

    def ask(self, kind, body, client=None):
        """Payload, error code and success flag of the answer; its number and type are checked."""
        client = client or self.client
        self.number += 1
        message = bytes([kind]) + body
        client.sendall(self.number.to_bytes(2, "big") + len(message).to_bytes(2, "big") + message)
        head = self.received(client, 4)
        answer = self.received(client, int.from_bytes(head[2:], "big"))
        assert (int.from_bytes(head[:2], "big"), answer[0]) == (self.number, kind)
        return answer[1:-3], int.from_bytes(answer[-3:-1], "big"), bool(answer[-1])

    def read(self, name):
        """The value; None where it is refused."""
        payload, code, ok = self.ask(0, field(name))
        assert (code == 1) == ok
        assert int.from_bytes(payload[:2], "big") == len(payload) - 2
        return payload[2:].decode() if ok else None

    def write(self, name, value):
        """Whether it was taken."""
        return self.ask(1, field(name) + field(value))[2]

    def received(self, client, count):
        """So many bytes, or fewer where the proxy hangs up; time passes until they are there."""
        data = b""
        while len(data) < count:
            self.until(lambda: select.select([client], [], [], 0)[0])
            piece = client.recv(count - len(data))
            if not piece:
                break
            data += piece
        return data

    def until(self, done):
        """Let time pass until `done()`."""
        self.kernel._heard_at = time.monotonic_ns()  # somebody is there: time need not keep to the wall
        turns = 0
        while not done():
            self.kernel._lockstep_turn()
            turns += 1
            assert turns < MOST_TURNS

    def fault(self, name, **settings):
        """A fault from now on."""
        self.faults.schedule(read_fault({"fault": name, "at_ms": self.kernel.now / 1e6, **settings}))
        self.let_pass(0.0)

    def let_pass(self, seconds):
        reached = []
        self.kernel.after(round(seconds * 1e9), lambda: reached.append(True))
        self.until(lambda: reached)


def field(text):
    return len(text).to_bytes(2, "big") + text.encode()


@pytest.fixture
def bench():
    """Start a proxy: `bench(proxy="kukavarproxy")`."""
    benches = []

    def begin(memory=None, **settings):
        benches.append(Bench(memory, **settings))
        return benches[-1]

    yield begin
    for one in benches:
        one.close()
