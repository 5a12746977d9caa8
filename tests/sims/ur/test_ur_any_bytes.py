"""Whatever comes, and however it is cut: the parsers raise nothing but what they state, and go on."""

from __future__ import annotations

import socket
import struct
from contextlib import suppress

from hypothesis import given, settings
from hypothesis import strategies as st

from sims.ur._script_expressions import ScriptError
from sims.ur._script_machine import Machine
from sims.ur._script_parser import Names, parsed
from sims.ur._script_words import ScriptStream
from tests.sims.ur.conftest import DASHBOARD, PRIMARY, RTDE, program

PIECES = (
    "def a():", "end", "if", "while", "x", "p", "[", "]", "(", ")", ",", ":", "=", "==", "1", "2.5", '"t"', "\n", "not",
    "and", "-", "*", "run", "kill", "return", "global", "thread b():", "textmsg", "sync", "#", "$ 1",
)  # fmt: skip


def textmsg(a, b=""):
    return None


def sync():
    yield


NAMES = Names(["textmsg"], ["textmsg", "sync"])


@settings(max_examples=300, deadline=None)
@given(st.lists(st.sampled_from(PIECES), max_size=25).map(" ".join))
def test_a_program_of_any_words_is_executed_or_refused(text):
    with suppress(ScriptError):
        machine = Machine(parsed(text, NAMES), {"textmsg": textmsg, "sync": sync})
        for _ in range(3):
            machine.cycle()
        machine.stop()


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text):
    with suppress(ScriptError):
        parsed(text, NAMES)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=80), st.integers(1, 7))
def test_a_stream_gives_the_same_programs_however_it_is_cut(data, size):
    whole, pieces = ScriptStream(), ScriptStream()
    expected = list(whole.feed(data))
    found = [one for i in range(0, len(data), size) for one in pieces.feed(data[i : i + size])]
    assert found == expected


def test_any_bytes_at_any_port_leave_the_controller_alive(bench):
    begun = bench()

    @settings(max_examples=60, deadline=None)
    @given(st.sampled_from((DASHBOARD, PRIMARY, RTDE)), st.binary(min_size=1, max_size=60))
    def send(port, data):
        client = begun.call(port)
        client.sendall(data)
        begun.let_pass(0.01)
        client.close()
        begun.let_pass(0.01)

    send()
    assert begun.command("robotmode").startswith("Robotmode:")
    assert begun.run(program('textmsg("alive")').splitlines()[1]) == ["alive"]


def test_clients_that_are_gone_at_once_do_no_harm(bench):
    begun = bench()
    for port in (DASHBOARD, PRIMARY, RTDE) * 5:
        client = begun.call(port)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # its end is a reset
        client.close()
    begun.let_pass(0.5)
    assert begun.command("robotmode") == "Robotmode: RUNNING"
    assert begun.servers.rtde.clients == begun.controller.messages.clients == []
