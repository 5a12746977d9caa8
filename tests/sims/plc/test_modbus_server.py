"""The simulated PLC's Modbus end, byte by byte, against the public specification."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sims.plc._modbus import Frame, FrameStream, answer

MS = 1_000_000


def exception(answer):
    assert len(answer) == 2
    assert answer[0] & 0x80
    return answer[1]


def test_discrete_inputs_come_lowest_bit_first(bench):
    assert bench().ask(b"\x02\x00\x00\x00\x0e") == bytes((2, 2, 0b1011_0011, 0b0001_1111))


def test_a_part_of_the_registers_can_be_read(bench):
    plc = bench()
    assert plc.ask(b"\x04\x00\x06\x00\x01") == bytes((4, 2)) + struct.pack(">H", 600)
    assert plc.ask(b"\x03\x00\x03\x00\x01") == bytes((3, 2)) + struct.pack(">H", 1000)


def test_each_way_to_write_is_echoed_and_kept(bench):
    plc = bench()
    assert plc.ask(b"\x05\x00\x04\xff\x00") == b"\x05\x00\x04\xff\x00"
    assert plc.ask(b"\x0f\x00\x05\x00\x02\x01\x03") == b"\x0f\x00\x05\x00\x02"
    assert plc.ask(b"\x01\x00\x00\x00\x09") == bytes((1, 2, 0b0111_0000, 0))
    assert plc.ask(b"\x06\x00\x01\x00\x2a") == b"\x06\x00\x01\x00\x2a"
    assert plc.ask(b"\x10\x00\x02\x00\x02\x04\x00\x07\x03\xe9") == b"\x10\x00\x02\x00\x02"
    assert plc.ask(b"\x03\x00\x00\x00\x04") == bytes((3, 8)) + struct.pack(">4H", 0, 42, 7, 1001)


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        (b"\x07", 1),
        (b"\x17\x00\x00\x00\x01", 1),
        (b"\x02\x00\x00\x00\x0f", 2),
        (b"\x04\x00\x0b\x00\x01", 2),
        (b"\x04\xff\xff\x00\x02", 2),
        (b"\x05\x00\x09\xff\x00", 2),
        (b"\x06\x00\x04\x00\x01", 2),
        (b"\x10\x00\x03\x00\x02\x04\x00\x01\x00\x01", 2),
        (b"\x02\x00\x00\x00\x00", 3),
        (b"\x02\x00\x00\x07\xd1", 3),
        (b"\x04\x00\x00\x00\x7e", 3),
        (b"\x04\x00\x00", 3),
        (b"\x05\x00\x04\x00\x01", 3),
        (b"\x0f\x00\x00\x07\xb1\xf7", 3),
        (b"\x10\x00\x00\x00\x7c\xf8", 3),
        (b"\x10\x00\x00\x00\x02\x02\x00\x01", 3),
        (b"\x06\x00\x03\x00\x32", 3),
    ],
)
def test_a_wrong_request_gets_the_exception_of_the_specification(bench, pdu, code):
    reply = bench().ask(pdu)
    assert reply[0] == pdu[0] | 0x80
    assert exception(reply) == code


def test_clamp_and_unclamp_together_are_refused_and_change_nothing(bench):
    plc = bench()
    assert exception(plc.ask(b"\x0f\x00\x01\x00\x02\x01\x03")) == 3
    assert plc.ask(b"\x01\x00\x00\x00\x09")[2:] == b"\x00\x00"


def test_an_unknown_unit_is_answered_as_by_a_gateway(bench):
    assert exception(bench().ask(b"\x04\x00\x00\x00\x01", unit=7)) == 0x0B


def test_the_identification_says_that_it_is_simulated(bench):
    assert b"SIM-" in bench().ask(b"\x2b\x0e\x01\x00")


def test_a_request_in_pieces_and_two_in_one_piece_are_answered_in_order(bench):
    plc = bench()
    two = plc.framed(b"\x06\x00\x01\x00\x05", 11) + plc.framed(b"\x03\x00\x01\x00\x01", 12)
    for i in range(len(two)):
        plc.client.sendall(two[i : i + 1])
    assert [plc.answer()[0], plc.answer()[0]] == [11, 12]
    plc.client.sendall(two)
    assert plc.answer() == (11, 1, b"\x06\x00\x01\x00\x05")
    assert plc.answer() == (12, 1, b"\x03\x02\x00\x05")


def test_what_is_not_modbus_is_hung_up_on(bench):
    plc = bench()
    other = plc.call()
    other.sendall(b"GET / HTTP/1.1\r\n\r\n")
    assert plc.received(other, 1) == b""
    assert len(plc.inputs()) == 14


def test_several_clients_are_served_and_only_the_first_is_counted(bench):
    plc = bench()
    assert len(plc.inputs()) == 14
    other = plc.call()
    for _ in range(3):
        assert plc.ask(b"\x03\x00\x01\x00\x01", client=other) == b"\x03\x02\x00\x00"
    assert plc.wire.written == 7 + 4


def test_an_answer_takes_five_to_twenty_milliseconds_of_the_cells_time(bench):
    plc = bench()
    delays = []
    for _ in range(100):
        asked_ns = plc.kernel.now
        plc.ask(b"\x03\x00\x01\x00\x01")
        delays.append((plc.kernel.now - asked_ns) / MS)
    assert min(delays) >= 5.0
    assert max(delays) <= 20.0
    assert max(delays) - min(delays) > 10.0


def test_requests_that_arrive_together_are_answered_one_after_another_each_after_its_own_delay(bench):
    plc = bench(delay_least_ms=10, delay_most_ms=10)
    asked_ns = plc.kernel.now
    plc.client.sendall(3 * plc.framed(b"\x03\x00\x01\x00\x01"))
    for _ in range(3):
        plc.answer()
    assert plc.kernel.now - asked_ns == 30 * MS


class NoTables:
    """A memory with nothing in it."""

    def discrete_inputs(self):
        return ()

    coils = input_registers = holding_registers = discrete_inputs

    def identification(self):
        return ("a", "b", "c")


@given(st.binary(min_size=1, max_size=253))
def test_any_request_gets_an_answer_that_fits_it(pdu):
    reply = answer(pdu, NoTables())
    assert reply[0] in (pdu[0], pdu[0] | 0x80)


@pytest.mark.parametrize(
    "header",
    [
        pytest.param(b"\x00\x01\x00\x01\x00\x06\x01", id="protocol 1, a possible length"),
        pytest.param(b"\x00\x01\x00\x00\x00\x01\x01", id="protocol 0, length without a function code"),
        pytest.param(b"\x00\x01\x00\x00\x00\xff\x01", id="protocol 0, one byte longer than the longest request"),
    ],
)
def test_a_header_with_another_protocol_or_an_impossible_length_breaks_the_stream(header):
    stream = FrameStream()
    assert list(stream.feed(header + bytes(260))) == []
    assert stream.broken
    assert list(stream.feed(Frame(1, 1, b"\x01").encode())) == []


@pytest.mark.parametrize("size", [1, 253])
def test_the_shortest_and_the_longest_request_are_frames(size):
    stream = FrameStream()
    assert list(stream.feed(Frame(7, 1, bytes(size)).encode())) == [Frame(7, 1, bytes(size))]
    assert not stream.broken


@given(st.lists(st.tuples(st.integers(0, 65535), st.integers(0, 255), st.binary(min_size=1, max_size=253))), st.data())
def test_frames_are_found_however_the_bytes_arrive(frames, data):
    sent = [Frame(*frame) for frame in frames]
    stream, rest, found = FrameStream(), b"".join(frame.encode() for frame in sent), []
    while rest:
        size = data.draw(st.integers(1, len(rest)))
        found += stream.feed(rest[:size])
        rest = rest[size:]
    assert found == sent
    assert not stream.broken
