"""The person's Ethernet configuration, as the controller takes or refuses it."""

from __future__ import annotations

from pathlib import Path

import pytest

from sims.krc.ethernet_config import BadConfig, read_config
from sims.krc.telegram import TelegramFormat

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
    assert [element.tag for element in config.send] == ["RIst", "AIPos", "ASPos", "MACur", "Delay"]
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
    ],
)
def test_a_mistake_is_named_with_the_file(tmp_path, old, new, named):
    path = changed(tmp_path, old, new)
    with pytest.raises(BadConfig, match=named) as caught:
        read_config(path)
    assert str(path) in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(BadConfig, match=r"none\.xml"):
        read_config(tmp_path / "none.xml")


def test_a_tag_that_the_controller_cannot_send_is_refused_by_name(tmp_path):
    config = read_config(changed(tmp_path, "DEF_MACur", "DEF_Tech.C1"))
    with pytest.raises(BadConfig, match=r"Tech\.C1"):
        TelegramFormat(config, 4, {})


def test_tags_of_external_axes_are_sent_as_six_zeros_whatever_the_robot_has(bench, tmp_path):
    pc = bench(ethernet=changed(tmp_path, "DEF_ASPos", "DEF_EIPos"))
    pc.rsi_on()
    (telegram,) = pc.cycles(1)
    assert '<EIPos E1="0.0000" E2="0.0000" E3="0.0000" E4="0.0000" E5="0.0000" E6="0.0000"/>' in telegram
    assert pc.finish()[1] == 0
