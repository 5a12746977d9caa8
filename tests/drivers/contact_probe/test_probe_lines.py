"""Lines of the probe: what is written comes back, and nothing that was spoilt on the way is believed."""

from __future__ import annotations

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.contact_probe.lines import (
    LONGEST,
    Boot,
    Confirmation,
    Edge,
    Fault,
    Heartbeat,
    Introduction,
    LineError,
    Opened,
    Reply,
    Splitter,
    Synced,
    check_sum,
    encode,
    parse_line,
)

WORDS = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E, exclude_characters=",*"), max_size=12)
SEQ, TICK, FLAG = st.integers(0, 0xFFFF), st.integers(0, 0xFFFF_FFFF), st.integers(0, 1)
MESSAGES = st.one_of(
    st.tuples(st.just("BOOT"), st.builds(Boot, TICK, WORDS)),
    st.tuples(st.just("ID"), st.builds(Introduction, SEQ, TICK, WORDS, WORDS, WORDS, TICK, WORDS)),
    st.tuples(st.just("HB"), st.builds(Heartbeat, WORDS, TICK, FLAG)),
    st.tuples(st.just("EDGE"), st.builds(Edge, TICK)),
    st.tuples(st.just("CONF"), st.builds(Confirmation, TICK, FLAG, TICK)),
    st.tuples(st.just("OPEN"), st.builds(Opened, TICK)),
    st.tuples(st.just("FAULT"), st.builds(Fault, WORDS)),
    st.tuples(st.just("SYNC"), st.builds(Synced, SEQ, TICK)),
    st.tuples(st.just("RE"), st.builds(Reply, SEQ, WORDS)),
)


def framed(body: str) -> bytes:
    """Written apart from the driver: the CRC from its definition, a bit at a time."""
    crc = 0xFFFF
    for byte in body.encode():
        for bit in range(7, -1, -1):
            carry = (crc >> 15) ^ (byte >> bit & 1)
            crc = (crc << 1 & 0xFFFF) ^ (0x1021 if carry else 0)
    return f"{body}*{crc:04X}\n".encode()


def written(kind: str, seq: int, tick: int, message: object) -> bytes:
    fields = (getattr(message, name) for name in message.__slots__)
    return framed(",".join(map(str, (kind, seq, tick, *fields))))


def test_the_check_sum_has_the_documents_check_value():
    assert check_sum(b"123456789") == 0x29B1


def test_a_command_is_framed_as_the_document_says():
    assert encode("ACK", 17) == framed("ACK,17")
    assert encode("HELLO", 0) == framed("HELLO,0")


@given(MESSAGES, SEQ, TICK)
def test_every_line_reads_back_as_it_was_written(message, seq, tick):
    kind, said = message
    line = parse_line(written(kind, seq, tick, said))
    assert (line.seq, line.tick, line.message) == (seq, tick, said)


@given(MESSAGES, SEQ, TICK, st.data())
def test_a_line_with_one_wrong_character_is_refused(message, seq, tick, data):
    raw = written(message[0], seq, tick, message[1])
    place = data.draw(st.integers(0, len(raw) - 2))
    wrong = data.draw(st.integers(0, 255).filter(lambda c: c != raw[place]))
    with pytest.raises(LineError):
        parse_line(raw[:place] + bytes([wrong]) + raw[place + 1 :])


@given(MESSAGES, SEQ, TICK, st.data())
def test_a_line_that_lost_or_gained_a_character_is_refused(message, seq, tick, data):
    raw = written(message[0], seq, tick, message[1])
    place = data.draw(st.integers(0, len(raw) - 2))
    with pytest.raises(LineError):
        parse_line(raw[:place] + raw[place + 1 :])


@given(st.binary(max_size=300))
def test_arbitrary_bytes_raise_nothing_but_a_line_error(raw):
    with suppress(LineError):
        parse_line(raw)


@pytest.mark.parametrize(
    "body",
    [
        "EDGE,1,2",  # a field too few
        "EDGE,1,2,3,4",  # one too many
        "GRBL,1,2,3",  # no such type
        "ACK,1,2",  # the host's own
        "EDGE,65536,2,3",
        "EDGE,1,4294967296,3",
        "EDGE,-1,2,3",
        "EDGE,+1,2,3",
        "EDGE,1_0,2,3",
        "EDGE, 1,2,3",
        "CONF,1,2,3,2,0",  # neither confirmed nor not
        "HB,1,2,ARMED,1e3,1",
        "",
    ],
)
def test_a_sound_check_sum_does_not_excuse_wrong_content(body):
    with pytest.raises(LineError):
        parse_line(framed(body))


def test_digits_of_other_scripts_are_no_numbers():
    with pytest.raises(LineError):
        parse_line(framed("EDGE,1,2,٣"))


def test_a_check_sum_in_small_letters_is_refused():
    raw = next(
        line for line in (framed(f"OPEN,0,0,{n}") for n in range(99)) if any(c in b"ABCDEF" for c in line[-5:-1])
    )
    with pytest.raises(LineError):
        parse_line(raw[:-5] + raw[-5:].lower())


def test_a_carriage_return_before_the_end_is_ignored():
    assert parse_line(framed("FAULT,1,2,WIRE").replace(b"\n", b"\r\n")).message == Fault("WIRE")


def test_a_line_of_more_than_120_characters_is_refused():
    fits = "FAULT,1,2," + "X" * (LONGEST - 5 - 10)
    assert parse_line(framed(fits)).message == Fault("X" * (LONGEST - 15))
    with pytest.raises(LineError):
        parse_line(framed(fits + "X"))


@given(st.lists(MESSAGES, max_size=6), st.data())
def test_lines_are_found_however_the_bytes_are_cut(messages, data):
    lines = [written(kind, n, 5, said) for n, (kind, said) in enumerate(messages)]
    stream, splitter, found = b"".join(lines), Splitter(), []
    while stream:
        cut = data.draw(st.integers(1, len(stream)))
        found += splitter.feed(stream[:cut])
        stream = stream[cut:]
    assert found == lines


def test_a_stream_without_line_ends_does_not_fill_the_memory_and_the_next_line_is_read():
    splitter = Splitter()
    for _ in range(1000):
        assert list(splitter.feed(b"\x00" * 1000)) == []
    rest, line = splitter.feed(b"\n" + framed("RE,1,2,3,OK"))
    assert len(rest) < 2 * LONGEST
    assert parse_line(line).message == Reply(3, "OK")
