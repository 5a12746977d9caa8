"""What the controller's readers take from the wire: ASCII numbers of a possible size, in small plain documents."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sims.krc._telegram import Element, read_reply
from sims.krc._xml_documents import count, decimal, parse

LARGEST, LARGEST_IPOC = 8192, 10**15
WIRED = (Element("AK.A1", "DOUBLE", True, False), Element("Stop", "BOOL", False, False))
ODD = [
    "", "1_0", "٣", "１", "²", " 1", "1 ", "1\n", "0x10", "1.", ".5", "+-1", "1e", "1,5", "nan", "inf", "-Infinity",
]  # fmt: skip


@given(st.floats(-3600, 3600), st.integers(0, 9))
def test_every_number_that_a_pc_prints_is_read_as_it_is(value, decimals):
    for text in (f"{value:.{decimals}f}", f"{value:.{decimals}e}", f"+{abs(value):.{decimals}f}"):
        assert decimal(text, 1e4) == float(text)


@pytest.mark.parametrize("text", ODD)
def test_what_is_no_ascii_decimal_is_refused(text):
    with pytest.raises(ValueError, match="is no number"):
        decimal(text, 1e6)


@pytest.mark.parametrize("text", ["1000001", "-1e7", "1e400"])
def test_what_is_larger_than_allowed_is_refused(text):
    with pytest.raises(ValueError, match="is outside ±1e\\+06"):
        decimal(text, 1e6)


@settings(max_examples=30)
@given(st.text(max_size=6))
def test_only_ascii_is_ever_a_number(text):
    try:
        decimal(text, 1e6)
    except ValueError:
        return
    assert set(text) <= set("+-.0123456789eE")


@pytest.mark.parametrize("text", ["-1", "+1", "1.0", "1_0", "٣", "", " 1", "1" * 17, str(LARGEST_IPOC + 1)])
def test_a_count_is_digits_alone_and_of_a_possible_size(text):
    assert count(str(LARGEST_IPOC), LARGEST_IPOC) == LARGEST_IPOC
    with pytest.raises(ValueError, match="is no whole number"):
        count(text, LARGEST_IPOC)


def answer(a1="0.5", stop="1", ipoc="123", before=""):
    return f'{before}<Sen Type="X"><AK A1="{a1}"/><Stop>{stop}</Stop><IPOC>{ipoc}</IPOC></Sen>'.encode()


def test_an_answer_is_read_by_name():
    reply = read_reply(answer(), WIRED)
    assert reply is not None
    assert (reply.sentype, reply.ipoc, reply.values) == ("X", 123, {"AK.A1": 0.5, "Stop": 1.0})


@pytest.mark.parametrize("odd", [*({"a1": text} for text in ODD), {"a1": "3600.1"}, {"a1": "-1e9"}, {"stop": "١"},
                                 {"ipoc": "-1"}, {"ipoc": "1_0"}, {"ipoc": "٣"}, {"ipoc": "1" * 17},
                                 {"ipoc": str(LARGEST_IPOC + 1)}])  # fmt: skip
def test_an_answer_with_an_impossible_number_is_none(odd):
    assert read_reply(answer(**odd), WIRED) is None


def test_an_answer_over_eight_kibibytes_is_none():
    room = LARGEST - len(answer())
    assert read_reply(answer() + b" " * room, WIRED) is not None
    assert read_reply(answer() + b" " * (room + 1), WIRED) is None


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_an_answer_with_entities_is_none(encoding):
    text = answer(a1="&a;", before='<!DOCTYPE Sen [<!ENTITY a "0.5">]>').decode()
    assert read_reply(text.encode(encoding), WIRED) is None


def test_elements_nested_as_deep_as_a_document_allows_are_read():
    depth = LARGEST // 7
    root = parse(b"<a>" * depth + b"</a>" * depth)
    assert sum(1 for _ in root.iter()) == depth
    with pytest.raises(ValueError, match="not XML"):
        parse(b"<a>" * (LARGEST // 3))
