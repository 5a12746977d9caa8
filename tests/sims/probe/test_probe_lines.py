"""The probe's lines: what counts as one, and what is dropped."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sims.probe._lines import HostLine, LineCutter, crc16, framed, parse_host_line


def test_the_check_sum_is_ccitt_false():
    assert crc16(b"123456789") == 0x29B1
    assert framed("123456789") == b"123456789*29B1\n"


def test_a_line_of_the_host_is_understood_with_or_without_carriage_return():
    line = framed("ARM,17").rstrip(b"\n")
    assert parse_host_line(line) == parse_host_line(line + b"\r") == HostLine("ARM", 17)


@pytest.mark.parametrize("body", ["NONSENSE,1", "NONSENSE,1,2.5,abc", "ARMS,1,"])
def test_a_type_that_the_probe_does_not_know_is_a_line_whatever_its_fields(body):
    assert parse_host_line(framed(body).rstrip(b"\n")) == HostLine(body.split(",")[0], 1)


@pytest.mark.parametrize(
    "body",
    [
        "ARM",
        "ARM,",
        "ARM,1,2",
        "ARM,-1",
        "ARM,65536",
        "ARM,01",
        "arm,1",
        "NONSENSE",
        "NONSENSE,65536",
        "HELLO,1,",
        "ARM,1 ",
        " ARM,1",
        "ARM,1.0",
    ],
)
def test_a_line_of_wrong_form_or_fields_is_dropped_though_its_check_sum_is_right(body):
    assert parse_host_line(framed(body).rstrip(b"\n")) is None


def test_a_lower_case_check_sum_is_wrong():
    line = next(line for n in range(100) if (line := framed(f"SYNC,{n}").rstrip(b"\n"))[-4:].lower() != line[-4:])
    assert parse_host_line(line) is not None
    assert parse_host_line(line[:-4] + line[-4:].lower()) is None


@given(st.sampled_from(["ACK", "HELLO", "ARM", "DISARM", "SYNC"]), st.integers(0, 65535), st.data())
def test_any_single_wrong_character_is_noticed(kind, seq, data):
    line = framed(f"{kind},{seq}").rstrip(b"\n")
    assert parse_host_line(line) == HostLine(kind, seq)
    place = data.draw(st.integers(0, len(line) - 1))
    other = data.draw(st.integers(0, 255).filter(lambda byte: byte != line[place]))
    assert parse_host_line(line[:place] + bytes([other]) + line[place + 1 :]) is None


@given(st.binary(max_size=200))
def test_nothing_that_arrives_raises(noise):
    parse_host_line(noise)


@given(st.lists(st.binary(max_size=130).map(lambda line: line.replace(b"\n", b"")), max_size=6), st.data())
def test_lines_are_cut_the_same_however_they_arrive(lines, data):
    stream = b"".join(line + b"\n" for line in lines)
    cutter, found, position = LineCutter(), [], 0
    while position < len(stream):
        size = data.draw(st.integers(1, len(stream) - position))
        found += [(line, position + count) for line, count in cutter.feed(stream[position : position + size])]
        position += size
    assert [line for line, _ in found] == [line for line in lines if len(line) <= 120]
    assert all(stream[:end].endswith(line + b"\n") for line, end in found)
