"""Documents out of a stream that TCP has cut as it liked."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sims.krc._eki_server import DocumentStream

LARGEST = 8192
DOCUMENTS = st.sampled_from(
    [
        b'<Cmd Id="1" Op="HALT"/>',
        b'<Cmd Id="2" Op="PTP"><Vel P="10.0"/><Q A1="0" A2="-90"/></Cmd>',
        b"<a><a></a><b/></a>",
        b'<Cmd Id=\'<>/"\' Op="a&gt;/>b"></Cmd>',
        b"<a><!-- </a> ' > --></a>",
        b"<?xml version='1.0' encoding=\"UTF-8\"?><a> x &lt; y </a>",
        b'<a><![CDATA[</a>>"]]></a>',
        "<Cmd Id='Größe'/>".encode(),
        b"< a>",
        b"</a>",
    ]
)
SPACE = st.text(" \t\r\n", max_size=3).map(str.encode)


def cut(data, places):
    edges = [0, *sorted({place % (len(data) + 1) for place in places}), len(data)]
    return [data[a:b] for a, b in itertools.pairwise(edges)]


def documents(pieces):
    stream = DocumentStream()
    return [document for piece in pieces for document in stream.feed(piece)]


@given(st.lists(st.tuples(DOCUMENTS.filter(lambda d: d != b"< a>"), SPACE)), st.lists(st.integers(0, 10_000)))
def test_documents_come_out_whole_wherever_the_stream_was_cut(parts, places):
    data = b"".join(document + space for document, space in parts)
    assert documents(cut(data, places)) == [document for document, _ in parts]


@given(
    st.binary(max_size=200) | st.lists(DOCUMENTS | st.binary(max_size=9)).map(b"".join), st.lists(st.integers(0, 999))
)
def test_whatever_comes_the_cuts_make_no_difference(data, places):
    assert documents(cut(data, places)) == documents([data])


@given(st.binary(max_size=100))
def test_after_any_nonsense_a_document_is_found_again_or_the_stream_is_over(nonsense):
    stream = DocumentStream()
    found = [document for data in (nonsense, b" " * (LARGEST + 1), b"<a/>") for document in stream.feed(data)]
    assert stream.overlong or found[-1] == b"<a/>"


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"hello<a/>", [b"hello", b"<a/>"]),
        (b"<a <b/>", [b"<a ", b"<b/>"]),
        (b"</a><b/>", [b"</a>", b"<b/>"]),
        (b"  \n<a/>  ", [b"<a/>"]),
        (b"<a>text", []),
    ],
)
def test_what_is_no_document_comes_out_by_itself_and_the_next_one_is_found(data, expected):
    assert documents([data]) == expected


def test_a_document_over_eight_kibibytes_ends_the_stream_and_the_rest_is_not_read():
    stream = DocumentStream()
    (beginning,) = stream.feed(b"<a>" + b"x" * 5_000_000)
    assert len(beginning) == LARGEST + 1
    assert stream.overlong
    assert list(stream.feed(b"</a><b/>")) == []


def test_a_document_of_eight_kibibytes_is_one():
    document = b"<a>" + b"x" * (LARGEST - 7) + b"</a>"
    stream = DocumentStream()
    assert list(stream.feed(document * 2)) == [document, document]
    assert not stream.overlong


def test_white_space_between_documents_has_any_length():
    assert documents([b" \n" * LARGEST + b"<a/>"]) == [b"<a/>"]
