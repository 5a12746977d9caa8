"""The person's Ethernet configuration, as the controller takes or refuses it."""

from __future__ import annotations

from pathlib import Path

import pytest

from sims.krc._telegram import BadConfig, TelegramFormat, read_config

SHIPPED = Path(__file__).parents[3] / "procedures/cells/rsi_ethernet.xml"


def changed(tmp_path, old, new):
    text = SHIPPED.read_text()
    assert old in text
    (tmp_path / "e.xml").write_text(text.replace(old, new))
    return tmp_path / "e.xml"


def test_the_shipped_configuration_is_read_in_its_order():
    config = read_config(SHIPPED)
    assert config.sentype == "CELLCTL"
    assert not config.only_send
    assert [element.tag for element in config.send] == ["RIst", "AIPos", "ASPos", "MACur", "Delay", "Tech.C2"]
    assert config.correction == tuple(f"AK.A{i}" for i in range(1, 7))
    assert config.stop == "Stop"
    assert [element.hold_on for element in config.receive] == [True] * 6 + [False]


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("<SENTYPE>CELLCTL</SENTYPE>", "", "SENTYPE"),
        ('TAG="AK.A6"', 'TAG="AK.B6"', "NAME.A1 … NAME.A6"),
        ('TAG="AK.A6"', 'TAG="AK.E1"', "AXISCORREXT"),
        ('TYPE="LONG"', 'TYPE="INT"', "Delay: TYPE"),
        ('TAG="DEF_MACur" ', "", "without TAG"),
        ("</ROOT>", "", "not XML"),
        ('TAG="DEF_MACur"', 'TAG="MACur"', "SEND: MACur: INDX INTERNAL belongs to a tag that begins with DEF_"),
        ('INDX="6"', 'INDX="65"', r"AK\.A6: Invalid index: INDX '65'"),
        ('INDX="6"', 'INDX="²"', r"AK\.A6: Invalid index"),
        ('TAG="Stop"', 'TAG="St op"', "St op: a TAG is NAME or NAME.ATTRIBUTE"),
        ('TAG="AK.A6"', 'TAG="AK.A5"', r"RECEIVE: AK\.A5 is there twice"),
    ],
)
def test_an_error_is_named_with_the_file(tmp_path, old, new, named):
    path = changed(tmp_path, old, new)
    with pytest.raises(BadConfig, match=named) as caught:
        read_config(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(BadConfig, match=r"none\.xml"):
        read_config(tmp_path / "none.xml")


def test_a_tag_that_the_controller_cannot_send_is_refused_by_name(tmp_path):
    config = read_config(changed(tmp_path, "DEF_MACur", "DEF_Tech.C7"))
    with pytest.raises(BadConfig, match=r"DEF_Tech\.C7"):
        TelegramFormat(config, 4, {})


def test_tags_of_external_axes_are_sent_as_six_zeros_whatever_the_robot_has(bench, tmp_path):
    pc = bench(ethernet=changed(tmp_path, "DEF_ASPos", "DEF_EIPos"))
    pc.rsi_on()
    (telegram,) = pc.cycles(1)
    assert '<EIPos E1="0.0000" E2="0.0000" E3="0.0000" E4="0.0000" E5="0.0000" E6="0.0000"/>' in telegram
    assert pc.finish()[1] == 0


def test_a_configuration_with_cartesian_corrections_alone_is_refused_with_what_to_write_instead(tmp_path):
    path = tmp_path / "e.xml"
    text = SHIPPED.read_text()
    for axis, name in enumerate("XYZABC", 1):
        text = text.replace(f'"AK.A{axis}"', f'"RKorr.{name}"')
    path.write_text(text)
    with pytest.raises(
        BadConfig, match=r"RKorr\.X … are Cartesian corrections .* put six DOUBLE tags NAME\.A1"
    ) as caught:
        read_config(path)
    assert str(path) in str(caught.value)


STOCK_SEND = """
      <ELEMENT TAG="DEF_RIst" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_AIPos" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_Delay" TYPE="LONG" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_Tech.C1" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="DiL" TYPE="LONG" INDX="1"/>
      <ELEMENT TAG="Digout.o1" TYPE="BOOL" INDX="2"/>
      <ELEMENT TAG="Digout.o2" TYPE="BOOL" INDX="3"/>
      <ELEMENT TAG="Digout.o3" TYPE="BOOL" INDX="4"/>
      <ELEMENT TAG="Source1" TYPE="DOUBLE" INDX="5"/>
      <ELEMENT TAG="DEF_Tech.T2" TYPE="DOUBLE" INDX="INTERNAL"/>
      <ELEMENT TAG="FTC.Fx" TYPE="DOUBLE" INDX="6"/>
      <ELEMENT TAG="Text" TYPE="STRING" INDX="7"/>
"""
STOCK_RECEIVE = """
      <ELEMENT TAG="DEF_EStr" TYPE="STRING" INDX="INTERNAL"/>
      <ELEMENT TAG="DEF_Tech.T2" TYPE="DOUBLE" INDX="INTERNAL" HOLDON="0"/>
      <ELEMENT TAG="FREE" TYPE="LONG" INDX="8" HOLDON="1"/>
      <ELEMENT TAG="DiO" TYPE="LONG" INDX="9" HOLDON="1"/>
      <ELEMENT TAG="Out.01" TYPE="BOOL" INDX="10" HOLDON="1"/>
"""


@pytest.fixture
def stock(tmp_path):
    """The tags of KUKA's Ethernet example, with joints and axis corrections."""
    text = SHIPPED.read_text()
    send = text[text.index("<ELEMENT TAG") : text.index("    </ELEMENTS>")]
    text = text.replace(send, STOCK_SEND).replace("<RECEIVE>\n    <ELEMENTS>", "<RECEIVE>\n<ELEMENTS>" + STOCK_RECEIVE)
    (tmp_path / "e.xml").write_text(text)
    return tmp_path / "e.xml"


def test_channels_with_nothing_wired_to_them_show_zero_in_the_form_of_their_type(stock):
    zeros = {"AIPos": lambda: (0.0,) * 6, "RIst": lambda: (0.0,) * 6, "Delay": lambda: (3,)}
    telegram = TelegramFormat(read_config(stock), 2, zeros).print(77).decode()
    c, t = (" ".join(f'{name}{i}="0.00"' for i in range(1, 11)) for name in ("C1", "T2"))
    assert telegram.partition("<Delay ")[2] == (
        f'D="3"/><Tech {c} {t}/><DiL>0</DiL><Digout o1="0" o2="0" o3="0"/><Source1>0.00</Source1>'
        '<FTC Fx="0.00"/><Text></Text><IPOC>77</IPOC></Rob>'
    )


def test_tags_of_kukas_ethernet_example_are_taken_and_those_not_wired_come_to_nothing(bench, stock):
    pc = bench(ethernet=stock)
    pc.rsi_on()
    telegram = pc.telegram()
    answer = (
        '<Sen Type="CELLCTL"><EStr>hello</EStr><Tech T21="1.0" T22="x"/><FREE>100000</FREE><DiO>٣</DiO>'
        '<AK A1="0.01" A2="0" A3="0" A4="0" A5="0" A6="0"/><Stop>0</Stop><IPOC>%s</IPOC></Sen>'
    )
    ipoc = telegram.partition("<IPOC>")[2].partition("<")[0]
    pc.udp.sendto((answer % ipoc).encode(), pc.robot)
    later = pc.cycles(3, (0.01, 0.0, 0.0, 0.0, 0.0, 0.0))[-1]
    assert '<AIPos A1="0.0100" ' in later
    assert '<Delay D="0"/>' in later
    assert pc.finish((0.01, 0.0, 0.0, 0.0, 0.0, 0.0))[1] == 0
