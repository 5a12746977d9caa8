"""A simulated device on its own port; the test is a client that writes bytes by hand, and lets time pass meanwhile."""

from __future__ import annotations

import select
import socket
import time

from sims.faults import Faults
from sims.kernel import Kernel
from tests.helpers.simulated_devices import catalogue, read_fault

PATIENCE_S = 60.0


class TcpBench:
    """A simulated device that the subclass starts, and its clients."""

    MOST_TURNS = 100_000

    def __init__(self):
        self.kernel = Kernel("lockstep")
        self.faults = Faults(self.kernel, catalogue())
        self.clients = []
        self.number = 0

    @property
    def port(self):
        raise NotImplementedError

    def stop(self):
        raise NotImplementedError

    def call(self):
        self.clients.append(socket.create_connection(("127.0.0.1", self.port), timeout=PATIENCE_S))
        return self.clients[-1]

    def close(self):
        self.stop()
        self.kernel.close()
        for client in self.clients:
            client.close()

    def received(self, client, count):
        """So many bytes, or fewer where the device hangs up; time passes until they are there."""
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
            assert turns < self.MOST_TURNS

    def fault(self, name, **settings):
        """A fault from now on."""
        self.faults.schedule(read_fault({"fault": name, "at_ms": self.kernel.now / 1e6, **settings}))
        self.let_pass(0.0)

    def let_pass(self, seconds):
        reached = []
        self.kernel.after(round(seconds * 1e9), lambda: reached.append(True))
        self.until(lambda: reached)
