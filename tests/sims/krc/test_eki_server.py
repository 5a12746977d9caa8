"""A PC that is gone and one that calls in its place, in the order in which a busy machine may tell of them."""

from __future__ import annotations

import select
import socket
from collections.abc import Callable

import pytest

from sims.krc._eki_server import MOST_UNSENT, EkiServer
from sims.wires import Wire


class KernelByHand:
    """Does what is asked for when the test says so."""

    now = 0

    def __init__(self) -> None:
        self.due: list[Callable[[], object]] = []
        self.delays_ns: list[int] = []

    def at(self, time_ns: int, action: Callable[[], object]) -> None:
        self.due.append(action)

    def after(self, delay_ns: int, action: Callable[[], object]) -> KernelByHand:
        self.delays_ns.append(delay_ns)
        return self

    def cancel(self) -> None:
        pass

    def watch(self, file: object, on_readable: Callable[[], object]) -> None:
        self.readable = on_readable

    def unwatch(self, file: object) -> None:
        pass


class Program:
    """Notes who is there."""

    def __init__(self) -> None:
        self.calls: list[str] = []

    def connected(self, send: Callable[[bytes], None]) -> None:
        self.send = send
        self.calls.append("connected")

    def disconnected(self) -> None:
        self.calls.append("disconnected")


@pytest.fixture
def served():
    kernel, program = KernelByHand(), Program()
    server = EkiServer(kernel, program, Wire())
    yield kernel, program, server
    server.close()


def calling(server):
    server._listener.setblocking(True)  # so that `accept` waits until the call is there
    line = socket.create_connection(("127.0.0.1", server.port), 60)
    server._accept()
    return line


def found_gone(kernel, program, line):
    """The PC hangs up with something unread; the controller learns of it by what it says next."""
    program.send(b"unread")
    line.recv(1)
    line.close()
    while not kernel.due:
        program.send(b"anybody there?")


def test_a_pc_that_calls_just_as_the_one_before_is_found_to_be_gone_is_not_hung_up_on(served):
    kernel, program, server = served
    found_gone(kernel, program, calling(server))
    with calling(server):
        kernel.due[0]()
        assert program.calls == ["connected", "disconnected", "connected"]


def test_a_pc_that_never_reads_is_hung_up_on(served):
    kernel, program, server = served
    with calling(server):
        sent = 0
        while not kernel.due:
            program.send(bytes(4096))
            sent += 4096
        assert sent > MOST_UNSENT
        kernel.due[0]()
        assert program.calls == ["connected", "disconnected"]


def test_a_command_is_taken_after_4_ms(served):
    kernel, _, server = served
    with calling(server) as line:
        kernel.delays_ns.clear()
        line.sendall(b'<Cmd Id="1" Op="HELLO"/>')
        assert select.select([server._peer], [], [], 60)[0]
        kernel.readable()
        assert kernel.delays_ns == [4_000_000]


def test_a_pc_that_is_found_to_be_gone_is_hung_up_on(served):
    kernel, program, server = served
    found_gone(kernel, program, calling(server))
    kernel.due[0]()
    assert program.calls == ["connected", "disconnected"]
