"""The transfer channel's documents, however TCP cuts them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.kuka_rsi.eki.channel import DocumentStream, Reply, Stat, point_to_point, read_document, write_command

Q = '<Q A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="45.0000" A6="0.0000"/>'
JOINTS = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
DOCUMENTS = [
    f'<Rep Id="7" Code="0" Text="">{Q}</Rep>',
    '<?xml version="1.0"?><Rep Id="1" Code="31" Text="KSS29002 a > b"><!-- <x> > --><Q/></Rep>',
    f'<Stat Seq="12" Mode="EXT" Prog="READY" Msg="it\'s > that">{Q}</Stat>',
    "<Rep Id='8' Code='10' Text='x/>'/>",
    '<Rep Id="1" Code="0" Text=""><Ident Serial="SIM-1" Model="M" KSS="8.3" Version="1"/><Q/></Rep>',
    "<Rep Id='9' Code='0'><![CDATA[</Rep>]]></Rep>",
]


@given(st.lists(st.sampled_from(DOCUMENTS), max_size=6), st.sampled_from(["", "\n", " \r\n "]), st.data())
def test_documents_come_out_whole_however_the_stream_is_cut(documents, between, data):
    stream, text = DocumentStream(), between.join([*documents, ""]).encode()
    cuts = sorted(data.draw(st.lists(st.integers(0, len(text)), max_size=8)))
    pieces = [text[a:b] for a, b in zip([0, *cuts], [*cuts, len(text)], strict=True)]
    found = [document for piece in pieces for document in stream.feed(piece)]
    assert found == [document.encode() for document in documents]
    assert [read_document(document) for document in found] == [read_document(d.encode()) for d in documents]


def test_a_reply_s_joints_are_missing_where_its_q_is_empty():
    assert read_document(DOCUMENTS[0].encode()) == Reply(7, 0, "", JOINTS, {})
    assert read_document(DOCUMENTS[4].encode()).joints is None
    assert read_document(DOCUMENTS[4].encode()).ident["Serial"] == "SIM-1"


def test_a_state_is_read_with_its_message():
    assert read_document(DOCUMENTS[2].encode()) == Stat("EXT", "READY", "it's > that", JOINTS)


@pytest.mark.parametrize(
    "document",
    [
        b"<Foo/>",
        b"<Rep Code='0'/>",
        b"<Rep Id='1' Code='x'/>",
        b"<Stat Mode='EXT' Prog='READY'/>",
        b"<Rep Id='1' Code='0'><Q A1='1'/></Rep>",
        b"<Rep Id='1' Code='0'><Q A1='1' A2='2' A3='3' A4='4' A5='nan' A6='6'/></Rep>",
        b"</Rep>",
    ],
)
def test_what_is_neither_reply_nor_state_is_refused(document):
    with pytest.raises(ValueError):
        read_document(document)


def test_a_document_that_never_ends_is_refused_at_four_kibibytes():
    stream = DocumentStream()
    assert stream.feed(b"<Rep Text='" + b"x" * 4000) == []
    with pytest.raises(ValueError, match="4096"):
        stream.feed(b"x" * 1000)


def test_a_whole_document_above_four_kibibytes_is_refused_though_it_comes_in_one_piece():
    long = b"<Rep Id='1' Code='0' Text='" + b"x" * 4096 + b"'/>"
    with pytest.raises(ValueError, match="4096"):
        DocumentStream().feed(long)
    short = b"<Rep Id='1' Code='0'/>"
    assert len(DocumentStream().feed(short * 1000)) == 1000


@given(st.binary(max_size=300))
def test_no_bytes_break_the_splitter(data):
    stream = DocumentStream()
    for document in stream.feed(data):
        assert document.strip() == document


def test_a_move_is_written_as_in_the_reference():
    assert write_command(7, "PTP", point_to_point(JOINTS, 10.0)) == (
        b'<Cmd Id="7" Op="PTP"><Vel P="10.0000"/><Q A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="45.0000" '
        b'A6="0.0000"/></Cmd>'
    )
