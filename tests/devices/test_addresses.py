"""Addresses say which driver, where, and with which settings; wrong ones say what is wrong."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.devices import Address

ROBOT = "kuka+rsi://0.0.0.0:49152?ethernet=a.xml&eki=1.2.3.4:54600"


def test_a_robots_address_is_read():
    assert Address.parse(ROBOT) == Address(
        "kuka+rsi", "0.0.0.0", 49152, "", {"ethernet": "a.xml", "eki": "1.2.3.4:54600"}
    )


def test_a_serial_ports_address_is_read():
    address = Address.parse("contact+serial:///dev/ttyACM0?baud=250000")
    assert (address.scheme, address.host, address.port) == ("contact+serial", "", None)
    assert (address.path, address.query) == ("/dev/ttyACM0", {"baud": "250000"})


@pytest.mark.parametrize(
    "text",
    [
        ROBOT,
        "contact+serial://?baud=250000",
        "contact+serial:///dev/ttyACM0?baud=250000",
        "contact+serial:///dev/serial/by-id/usb-Arduino_1-if00",
        "kuka+rsi://127.0.0.1:0?ethernet=rsi_ethernet.xml",
        "kuka+rsi://127.0.0.1:0?ethernet=../cells/rsi.xml",
        "modbus+tcp://plc.local:502?unit=1",
        "modbus+tcp://[::1]:502?unit=1",
        "canopen+socketcan://can0?bitrate=1000000",
        "x://host?empty=",
    ],
)
def test_an_address_is_written_as_it_was_read(text):
    assert str(Address.parse(text)) == text


SETTINGS = st.dictionaries(st.text("abc_", min_size=1), st.text(st.characters(codec="utf-8"), max_size=8), max_size=3)


@given(SETTINGS, st.none() | st.integers(0, 65535), st.sampled_from(["", "/dev/ttyS0", "/a b"]))
def test_any_settings_survive_writing_and_reading(query, port, path):
    address = Address("x+y", "host", port, path, query)
    assert Address.parse(str(address)) == address


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no device address"),
        ("/dev/ttyACM0", "no device address"),
        ("host:502", "no device address"),
        ("contact+serial:/dev/x?next=a://b", "no device address"),
        ("://host", "no device address"),
        ("x://host:99999", "x://host:99999"),
        ("x://host:port", "x://host:port"),
        ("x://host:-1", "x://host:-1"),
        ("x://[::1", "x://"),
        ("x://h?a=1&a=2", "twice"),
        ("x://h?baud", "baud"),
        ("x://me:secret@h", "user"),
        ("x:///dev/tty#1", "#"),
        ("x://999.1.1.1:502", "no IP address"),
        ("x://10.0.0:502", "no IP address"),
        ("x://[10::0::5]:502", "no"),
        ("x://two words", "letters, digits"),
        ("x://plc..local", "letters, digits"),
        ("x://-plc", "letters, digits"),
    ],
)
def test_what_is_no_address_is_a_value_error_that_says_why(text, words):
    with pytest.raises(ValueError, match=words.replace("?", r"\?").replace("[", r"\[")):
        Address.parse(text)
