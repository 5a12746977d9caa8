"""Mistakes in the address, the limits and the Ethernet configuration are named, all at once, with file and line."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, DeviceRefused, Surroundings
from drivers.kuka_rsi.description import check_address, open_robot

GOOD = "kuka+rsi://127.0.0.1:0?ethernet=rsi.xml&eki=127.0.0.1:54600"


@pytest.fixture
def errors(tmp_path, ethernet_xml):
    def check(*changes: tuple[str, str], address: str = GOOD) -> list[str]:
        xml = ethernet_xml
        for before, after in changes:
            assert before in xml
            xml = xml.replace(before, after)
        (tmp_path / "rsi.xml").write_text(xml)
        return [text.replace(f"{tmp_path}/", "") for text in check_address(Address.parse(address), tmp_path)]

    return check


def test_the_shipped_cell_s_configuration_has_no_error():
    cells = Path(__file__).resolve().parents[3] / "procedures/cells"
    address = "kuka+rsi://127.0.0.1:0?ethernet=rsi_ethernet.xml&eki=127.0.0.1:54600"
    assert check_address(Address.parse(address), cells) == []


@pytest.mark.parametrize(
    ("before", "after", "line", "what"),
    [
        ("DEF_AIPos", "DEF_ASPos", 8, "SEND lacks DEF_AIPos"),
        ("DEF_Delay", "DEF_MACur", 8, 'add <ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/>'),
        ('TAG="DEF_Delay" TYPE="LONG"', 'TAG="DEF_Delay" TYPE="STRING"', 11, "must be <ELEMENT TAG="),
        ('TAG="DEF_AIPos" TYPE="DOUBLE"', 'TAG="DEF_AIPos" TYPE="LONG"', 10, "DEF_AIPos (the actual joints) must be"),
        ('TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"', 'TAG="DEF_Delay" TYPE="LONG" INDX="1"', 11, "INTERNAL"),
        ('INDX="7" HOLDON="0"', 'INDX="7" HOLDON="1"', 20, 'Stop has no HOLDON="0"'),
        ("<ONLYSEND>FALSE", "<ONLYSEND>TRUE", 6, "ONLYSEND"),
        ("<SENTYPE>CELLCTL</SENTYPE>", "<SENTYPE/>", 5, "SENTYPE"),
        ("<SENTYPE>CELLCTL</SENTYPE>", "", 2, "SENTYPE"),
        ('TAG="AK.A3"', 'TAG="AK.B3"', 13, "RECEIVE lacks AK.A3"),
        ('TAG="Stop"', 'TAG="Halt"', 13, "RECEIVE lacks Stop"),
        ('TAG="Stop" TYPE="BOOL"', 'TAG="Stop" TYPE="LONG"', 20, "Stop is LONG, not BOOL"),
        ('TAG="AK.A2" TYPE="DOUBLE"', 'TAG="AK.A2" TYPE="BOOL"', 15, "AK.A2 is BOOL"),
        ('INDX="2" HOLDON="1"', 'INDX="2" HOLDON="0"', 15, "HOLDON"),
        ('INDX="2"', 'INDX="1"', 15, "INDX 1 stands on line 14"),
        ('INDX="7"', 'INDX="65"', 20, "INDX '65'"),
        ('TAG="AK.A2"', 'TAG="AK.A1"', 15, "TAG AK.A1 stands on line 14"),
        ("</ROOT>", "", 23, "not XML"),
    ],
)
def test_each_error_in_the_file_is_named_with_its_line(errors, before, after, line, what):
    found = errors((before, after))
    assert [text for text in found if text.startswith(f"rsi.xml:{line}: ") and what in text], found


def test_a_controller_whose_late_answers_nobody_could_count_is_not_connected_to(tmp_path, ethernet_xml):
    (tmp_path / "rsi.xml").write_text(ethernet_xml.replace("DEF_Delay", "DEF_MACur"))
    robot = open_robot("robot", Address.parse(GOOD), Surroundings(WallClock(), tmp_path))
    with pytest.raises(DeviceRefused, match="SEND lacks DEF_Delay"):
        asyncio.run(robot.connect())


def test_all_errors_are_named_at_once(errors):
    found = errors(("DEF_AIPos", "DEF_X"), ("FALSE", "TRUE"), ('TAG="Stop"', 'TAG="Go"'))
    assert len(found) == 3


def test_a_port_that_the_controller_does_not_send_to_is_an_error(errors):
    assert errors(address=GOOD.replace(":0?", ":49153?")) == [
        "rsi.xml:4: PORT is 49152, the address binds 49153: no telegram would come"
    ]
    assert errors(address=GOOD.replace(":0?", ":49152?")) == []


def test_a_missing_file_is_named(tmp_path):
    (text,) = check_address(Address.parse(GOOD), tmp_path)
    assert "rsi.xml" in text
    assert "No such file" in text


def test_a_root_of_another_kind_is_named(tmp_path):
    (tmp_path / "rsi.xml").write_text("<RSIObject/>")
    assert "RSIObject" in check_address(Address.parse(GOOD), tmp_path)[0]


@pytest.mark.parametrize(
    ("address", "what"),
    [
        ("kuka+rsi://127.0.0.1:0?eki=h:1", "'ethernet' is missing"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f", "'eki' is missing"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h", "HOST:PORT"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:0", "HOST:PORT"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&stop=", "'stop' is empty"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&stopp=S", "unknown setting 'stopp'"),
        ("kuka+rsi://?ethernet=f&eki=h:1", "host to bind"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&controller=krc", "controller=krc is no IP address"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&controller=", "controller= is no IP address"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&cycle=4", "cycle=4 is none of ipo_fast (4 ms), ipo (12 ms)"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&tolerance=0", "tolerance=0 is no number of cycles within 1"),
        (
            "kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&tolerance=126",
            "tolerance=126 is no number of cycles within 1 … 125 (0.5 s at 4 ms)",
        ),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&cycle=ipo&tolerance=42", "within 1 … 41 (0.5 s at 12 ms)"),
        ("kuka+rsi://127.0.0.1:0?ethernet=f&eki=h:1&tolerance=1e2", "tolerance=1e2"),
    ],
)
def test_errors_in_the_address_are_named(tmp_path, address, what):
    with pytest.raises(ValueError, match=re.escape(what)):
        open_robot("robot", Address.parse(address), Surroundings(WallClock(), tmp_path))
    assert what in check_address(Address.parse(address), tmp_path)[0]


@pytest.mark.parametrize("limits", [{"speed": 1.0}, {"speed_deg_s": 0.0}, {"travel_deg": float("inf")}])
def test_unknown_limits_and_senseless_ones_are_refused(tmp_path, limits):
    with pytest.raises(ValueError, match="robot limit"):
        open_robot("robot", Address.parse(GOOD), Surroundings(WallClock(), tmp_path, limits))
