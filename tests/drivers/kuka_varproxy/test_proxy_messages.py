"""Requests and answers byte by byte; the samples are of the published specification and of a foreign client."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.kuka_varproxy import variables
from drivers.kuka_varproxy.line import UNKNOWN, Answer, AnswerStream, Kind, request, text_field, wide_field

PUBLISHED_ANSWER = bytes.fromhex("0100 0008 05 0001 3500 0001 01")
"""C3 Bridge Interface Protocol 1.5, section 3.5.6: the answer to writing 5 to $OV_PRO."""

READ_OV_PRO = b"\x00\x2a\x00\x0a\x00\x00\x07$OV_PRO"
WRITE_OV_PRO = b"\x00\x2b\x00\x0e\x01\x00\x07$OV_PRO\x00\x02" + b"50"
"""As py_openshowvar 1.1.7 sends them."""


def test_a_request_has_the_bytes_that_a_foreign_client_sends():
    assert request(42, Kind.READ, text_field("$OV_PRO")) == READ_OV_PRO
    assert request(43, Kind.WRITE, text_field("$OV_PRO") + text_field("50")) == WRITE_OV_PRO


def test_the_published_answer_is_read():
    (answer,) = AnswerStream().feed(PUBLISHED_ANSWER)
    assert answer == Answer(256, 5, bytes.fromhex("0001 3500"), 1, True)


@pytest.mark.parametrize(("tail", "ok"), [("000101", True), ("000000", False), ("000700", False)])
def test_the_footer_tells_success(tail, ok):
    (answer,) = AnswerStream().feed(bytes.fromhex("0007 0008 00 0002 3530") + bytes.fromhex(tail))
    assert (answer.ok, answer.text) == (ok, "50")


@pytest.mark.long
@given(st.lists(st.binary(max_size=300), min_size=1, max_size=5), st.data())
def test_answers_come_out_however_tcp_splits_them(payloads, data):
    stream = b"".join(
        n.to_bytes(2, "big") + (len(p) + 4).to_bytes(2, "big") + b"\x00" + p + b"\x00\x01\x01"
        for n, p in enumerate(payloads)
    )
    cuts = sorted(data.draw(st.sets(st.integers(0, len(stream)), max_size=8)))
    splitter = AnswerStream()
    found = [a for i, j in zip([0, *cuts], [*cuts, len(stream)], strict=True) for a in splitter.feed(stream[i:j])]
    assert [(a.id, a.payload) for a in found] == list(enumerate(payloads))


def test_a_length_that_no_answer_has_is_an_error():
    with pytest.raises(ValueError, match="shortest"):
        AnswerStream().feed(b"\x00\x01\x00\x03 no message")


def test_a_length_of_zero_is_the_answer_to_a_type_that_the_proxy_does_not_know():
    (answer,) = AnswerStream().feed(b"\x00\x01\x00\x00")
    assert (answer.id, answer.kind, answer.ok) == (1, UNKNOWN, False)


def test_a_text_of_another_length_than_announced_is_an_error():
    (answer,) = AnswerStream().feed(bytes.fromhex("0007 0008 00 0009 3530 000101"))
    with pytest.raises(ValueError, match="9 bytes is announced"):
        _ = answer.text


def test_a_message_that_the_length_field_cannot_state_is_not_sent():
    with pytest.raises(ValueError, match="65535 fit"):
        request(1, Kind.WRITE, bytes(65535))


def test_wide_texts_are_little_endian_and_count_characters():
    assert wide_field("PING") == bytes.fromhex("0004 5000 4900 4e00 4700")


def test_structures_are_read_as_controllers_print_them():
    text = "{E6AXIS: A1 -0.000012, A2 -90.0, A3 9.0E1, A4 0, A5 45.5, A6 1, E1 0.0, E2 0.0}"
    assert variables.joints(text) == (-0.000012, -90.0, 90.0, 0.0, 45.5, 1.0)
    assert variables.fields('{KV_BANK_T: ID[] "a, b", ROWS 3}') == {"ID[]": '"a, b"', "ROWS": "3"}


@pytest.mark.parametrize("text", ["", "#EX", "{E6AXIS: A1 0.0}", "{A1 x, A2 0, A3 0, A4 0, A5 0, A6 0}", "{A1 nan"])
def test_what_is_no_pose_is_an_error(text):
    with pytest.raises(ValueError):
        variables.joints(text)


@given(st.dictionaries(st.sampled_from(["A1", "ROW", "CHECK"]), st.integers(-(2**31), 2**31 - 1), min_size=1))
def test_a_written_structure_is_the_same_in_another_order_and_not_with_another_number(values):
    written = variables.structure("KV_JOB_T", values)
    turned = variables.structure("kv_job_t", dict(reversed(values.items())))
    assert variables.same(written, turned)
    assert not variables.same(written, variables.structure("KV_JOB_T", {**values, "A1": values.get("A1", 0) ^ 1}))
