"""The simulated proxy on its own port; the test is a client that writes its bytes by hand, and lets time pass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from sims.bench import setup_of
from sims.cell import read_cell
from sims.memory import Memory
from sims.varproxy._controller import start
from tests.helpers.sims import TcpBench

SHIPPED = read_cell(Path(__file__).parents[3] / "procedures/cells/varproxy_cell.yaml")


class Bench(TcpBench):
    """The simulated proxy, and one client."""

    MOST_TURNS = 200_000

    def __init__(self, memory=None, **settings):
        super().__init__()
        varproxy = {**SHIPPED.simulate.settings["varproxy"], **settings}
        simulate = replace(SHIPPED.simulate, settings={**SHIPPED.simulate.settings, "varproxy": varproxy})
        setup = setup_of(
            replace(SHIPPED, simulate=simulate), "robot", self.kernel, self.faults, memory=memory or Memory()
        )
        self.scene, self.wire, self.memory = setup.scene, setup.wire, setup.memory
        self.controller = start(setup)
        self.client = self.call()

    @property
    def port(self):
        return self.controller.server.port

    def stop(self):
        self.controller.close()

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
