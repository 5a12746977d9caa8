"""Telegrams and replies, byte for byte."""

from __future__ import annotations

from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.kuka_rsi.cyclic.telegram import ReplyFormat, ReplyTag, read_telegram

CAPTURED = (
    b'<Rob Type="KUKA"><RIst X="1143.9012" Y="0.0000" Z="1268.4000" A="0.0000" B="89.9900" C="0.0000"/>'
    b'<RSol X="1143.9" Y="0.0" Z="1268.4" A="0.0" B="90.0" C="0.0"/>'
    b'<AIPos A1="-0.0012" A2="-90.0000" A3="90.0001" A4="0.0000" A5="0.0000" A6="11.7000"/>'
    b'<ASPos A1="0.0" A2="-90.0" A3="90.0" A4="0.0" A5="0.0" A6="2.0"/>'
    b'<MACur A1="-0.2" A2="3.4" A3="2.0" A4="0.1" A5="0.0" A6="0.0"/><Delay D="3"/>'
    b'<Tech C11="0.0" C12="0.0"/><DiL>0</DiL><IPOC>4208163634</IPOC></Rob>'
)

AK = tuple(ReplyTag(f"AK.A{i}", "DOUBLE") for i in range(1, 7))
STOP = ReplyTag("Stop", "BOOL")

readings = st.tuples(*[st.floats(-360, 360, allow_nan=False)] * 6)


def test_actual_joints_are_read_by_name_not_the_set_points_beside_them():
    telegram = read_telegram(CAPTURED)
    assert telegram.joints == (-0.0012, -90.0, 90.0001, 0.0, 0.0, 11.7)
    assert (telegram.ipoc, telegram.delay) == (4208163634, 3)


@pytest.mark.parametrize(("value", "resolution"), [("0.5", 0.1), ("0.12", 0.01), ("7", 0.1)])
def test_the_resolution_is_read_from_the_decimals(value, resolution):
    axes = " ".join(f'A{i}="{value}"' for i in range(1, 7))
    assert read_telegram(f"<Rob><AIPos {axes}/><IPOC>0</IPOC></Rob>".encode()).resolution_deg == pytest.approx(
        resolution
    )


@pytest.mark.parametrize(("ipoc", "delay"), [("0", "0"), ("1000000000000000", "1000000000"), ("12", "3.000")])
def test_counts_are_read_up_to_their_bounds(ipoc, delay):
    telegram = read_telegram(CAPTURED.replace(b"4208163634", ipoc.encode()).replace(b'D="3"', f'D="{delay}"'.encode()))
    assert (telegram.ipoc, telegram.delay) == (int(ipoc), round(float(delay)))


def test_a_telegram_without_a_late_count_has_none():
    telegram = read_telegram(b'<Rob><AIPos A6="6" A5="5" A4="4" A3="3" A2="2" A1="1"/><IPOC>0</IPOC></Rob>')
    assert telegram.delay is None
    assert telegram.joints == (1, 2, 3, 4, 5, 6)


def test_the_count_is_echoed_as_it_was_written():
    telegram = read_telegram(CAPTURED.replace(b"4208163634", b"0004208163634"))
    reply = ReplyFormat.of("ImFree", (*AK, STOP), "AK", "Stop").write((0.0,) * 6, False, telegram.ipoc_text)
    assert reply.endswith(b"<IPOC>0004208163634</IPOC></Sen>")


@pytest.mark.parametrize(
    "datagram",
    [
        b"",
        b"\x00\xff",
        CAPTURED[:-1],
        CAPTURED * 2,
        CAPTURED.replace(b"Rob", b"Sen"),
        CAPTURED.replace(b"IPOC", b"IPO"),
        CAPTURED.replace(b">4208163634<", b"><"),
        CAPTURED.replace(b'A6="11.7000"', b""),
        CAPTURED.replace(b'"11.7000"', b'"nan"'),
        CAPTURED.replace(b'"11.7000"', b'"inf"'),
        CAPTURED.replace(b'D="3"', b'D="many"'),
        CAPTURED.replace(b"<AIPos", b"<AIPOs"),
        CAPTURED.replace(b">4208163634<", b">99999999999999999999<"),
        CAPTURED.replace(b">4208163634<", b">-4<"),
        CAPTURED.replace(b">4208163634<", b">42_08<"),
        CAPTURED.replace(b">4208163634<", "><٤٢<".encode()),
        CAPTURED.replace(b">4208163634<", b"> 42 <"),
        CAPTURED.replace(b">4208163634<", b">" + b"9" * 10_000 + b"<"),
        CAPTURED.replace(b'D="3"', b'D="1e300"'),
        CAPTURED.replace(b'D="3"', b'D="-1"'),
        CAPTURED.replace(b'D="3"', b'D="1_0"'),
        CAPTURED.replace(b'"11.7000"', b'"3600.1"'),
        CAPTURED.replace(b'"11.7000"', b'"1_1.7"'),
        CAPTURED.replace(b'"11.7000"', '"١١"'.encode()),
        CAPTURED.replace(b'"11.7000"', b'"0x10"'),
        b'<!DOCTYPE Rob [<!ENTITY a "1">]>' + CAPTURED,
    ],
)
def test_what_is_no_telegram_is_refused(datagram):
    with pytest.raises(ValueError):
        read_telegram(datagram)


@given(st.binary(max_size=200))
def test_no_bytes_at_all_can_do_more_than_be_refused(datagram):
    with pytest.raises(ValueError):
        read_telegram(datagram)


@given(st.integers(0, len(CAPTURED) - 1), st.integers(0, 255))
def test_a_corrupted_byte_is_refused_or_read_as_finite_numbers(place, value):
    corrupted = CAPTURED[:place] + bytes([value]) + CAPTURED[place + 1 :]
    try:
        telegram = read_telegram(corrupted)
    except ValueError:
        return
    assert all(abs(joint) < float("inf") for joint in telegram.joints)


@given(readings, st.integers(0, 2**40), st.permutations(range(4)))
def test_joints_survive_any_order_of_elements(joints, ipoc, order):
    axes = " ".join(f'A{i}="{value!r}"' for i, value in enumerate(joints, 1))
    elements = [f"<AIPos {axes}/>", '<RIst X="1"/>', "<Foo>7</Foo>", f"<IPOC>{ipoc}</IPOC>"]
    telegram = read_telegram(f"<Rob>{''.join(elements[i] for i in order)}</Rob>".encode())
    assert (telegram.joints, telegram.ipoc) == (joints, ipoc)


def test_a_reply_keeps_the_configuration_s_order_whatever_it_is():
    tags = (ReplyTag("DEF_EStr", "STRING"), STOP, *reversed(AK), ReplyTag("DiO", "LONG"), ReplyTag("EK.E1", "DOUBLE"))
    reply = ReplyFormat.of("ImFree", tags, "AK", "Stop").write((1, 2, 3, 4, 5, 6.5), True, "8")
    assert reply == (
        b'<Sen Type="ImFree"><EStr></EStr><Stop>1</Stop>'
        b'<AK A6="6.500000" A5="5.000000" A4="4.000000" A3="3.000000" A2="2.000000" A1="1.000000"/>'
        b'<DiO>0</DiO><EK E1="0.000000"/><IPOC>8</IPOC></Sen>'
    )


def test_technology_parameters_are_sent_as_the_ten_attributes_they_are():
    reply = ReplyFormat.of("X", (ReplyTag("DEF_Tech.T2", "DOUBLE"), *AK, STOP), "AK", "Stop").write(
        (0,) * 6, False, "1"
    )
    tech = ElementTree.fromstring(reply).find("Tech")
    assert list(tech.attrib) == [f"T2{i}" for i in range(1, 11)]


@given(readings, st.booleans(), st.text(st.characters(codec="utf-8", exclude_categories=["C"]), min_size=1))
def test_whatever_is_sent_can_be_read_back_to_a_millionth_of_a_degree(correction, stop, sentype):
    reply = ReplyFormat.of(sentype, (*AK, STOP), "AK", "Stop").write(correction, stop, "12")
    root = ElementTree.fromstring(reply)
    assert root.get("Type") == sentype
    assert root.findtext("Stop") == str(int(stop))
    read = [float(root.find("AK").get(f"A{i}")) for i in range(1, 7)]
    assert read == pytest.approx(correction, abs=5.1e-7)
