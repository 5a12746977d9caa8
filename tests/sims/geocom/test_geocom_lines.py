"""GeoCOM's lines by hand: requests and replies as in the reference manual, with and without checksum."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sims.geocom._protocol import Request, WrongChecksum, WrongFormat, crc16, parse_request, read_string, reply, written


def test_the_checksum_is_crc_16_arc():
    assert crc16(b"123456789") == 0xBB3D
    assert crc16(b"") == 0


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (b"%R1Q,5004:", Request(5004, ())),
        (b"%R1Q,0,17:", Request(0, (), 17)),
        (b"%R1Q,2008,3:1,1", Request(2008, ("1", "1"), 3)),
        (b"%R1Q,9027,32767:3.141593,-1.5,0,0,0", Request(9027, ("3.141593", "-1.5", "0", "0", "0"), 32767)),
        (b'%R1Q,17024,4:4,"SMR, 1.5\\"",-0.0038,1', Request(17024, ("4", '"SMR, 1.5\\""', "-0.0038", "1"), 4)),
        (b"%R1Q,2008,5:0x1,0x1", Request(2008, ("0x1", "0x1"), 5)),
    ],
)
def test_requests_are_read(line, expected):
    assert parse_request(line) == expected


def test_a_request_with_its_checksum_is_read_and_with_another_refused():
    text = b"%R1Q,2008,7:1,1"
    right = f"%R1Q,2008,7,{crc16(text)}:1,1".encode()
    assert parse_request(right) == Request(2008, ("1", "1"), 7, checked=True)
    with pytest.raises(WrongChecksum):
        parse_request(right.replace(b"1,1", b"1,0"))


@pytest.mark.parametrize("line", [b"hello", b"%R1P,0,0:0", b"%R1Q,70000:", b"%R1Q,:", b" %R1Q,0:", b'%R1Q,5004:"open'])
def test_what_is_no_request_is_refused(line):
    with pytest.raises(WrongFormat):
        parse_request(line)


def test_replies_have_both_codes_the_transaction_and_the_checksum_if_it_was_asked_for():
    assert reply(0, ("0",)) == b"%R1P,0,0:0\r\n"
    assert reply(12, ("1285", "1.5"), com=0) == b"%R1P,0,12:1285,1.5\r\n"
    text = b"%R1P,3108,9:0"
    assert reply(9, ("0",), com=3108, checked=True) == b"%%R1P,3108,9,%d:0\r\n" % crc16(text)


def test_values_are_written_as_their_types():
    assert written("SIM-TDRA6000", 15) == '"SIM-TDRA6000"'
    assert written('5" \\ 50% ~é', 15) == '"5\\" \\\\ 50\\% \\~\\xE9"'
    assert written(True, 3) == "1"
    assert written(math.pi, 4) == "3.1416"
    assert float(written(math.pi, 15)) == pytest.approx(math.pi, abs=1e-15)


@given(st.text(st.characters(max_codepoint=255)))
def test_a_string_that_is_written_reads_as_it_was(text):
    assert read_string(written(text, 15)) == text


@given(st.binary(max_size=80))
def test_any_line_is_a_request_or_refused(line):
    try:
        found = parse_request(line)
    except (WrongFormat, WrongChecksum):
        return
    assert 0 <= found.rpc <= 65_535
