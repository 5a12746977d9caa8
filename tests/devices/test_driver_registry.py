"""A driver is one entry point that yields one description: another package can bring its own, with nothing else."""

from __future__ import annotations

import sys
from pathlib import Path
from textwrap import dedent

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, CompensatedRobot, ContactProbe, CurrentSource, Finding, Surroundings
from cellctl.devices.registry import DriverRegistry
from cellctl.procedure.check import missing_abilities

LAMP = """
from cellctl.devices import Device, DriverDescription, Finding

class Lamp:
    def __init__(self, name, surroundings):
        self.name, self.limits = name, surroundings.limits

    def shine(self): ...

def open_lamp(name, address, surroundings):
    if not address.host:
        raise ValueError("no host")
    if surroundings.limits.get("watts", 0) > 10:
        raise ValueError("too bright")
    return Lamp(name, surroundings)

PLAIN = DriverDescription(open_lamp, Lamp)
FULL = DriverDescription(
    open=open_lamp,
    abilities=Lamp,
    check_address=lambda address, folder: [f"{folder.name} has no bulb"],
    check_setup=lambda address, surroundings: [Finding("dim", "more watts", "watts", warning=True)],
    controller_files=lambda cell, address, surroundings: {"lamp.txt": f"{cell} {address.host}"},
)
FUNCTION = open_lamp
"""


@pytest.fixture
def lamps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> DriverRegistry:
    """The registry with a package that brings four drivers of its own, two of them no good."""
    (tmp_path / "lamp_driver.py").write_text(LAMP)
    info = tmp_path / "lamp_driver-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lamp-driver\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        dedent("""
        [cellctl.devices]
        lamp = lamp_driver:PLAIN
        lamp+full = lamp_driver:FULL
        lamp+old = lamp_driver:FUNCTION
        lamp+gone = lamp_driver:NOWHERE
        """)
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "lamp_driver", raising=False)
    return DriverRegistry()


@pytest.fixture
def dim(tmp_path: Path) -> Surroundings:
    return Surroundings(WallClock(), tmp_path / "cellar", {"watts": 5.0})


def test_the_shipped_drivers_tell_what_their_devices_can_do() -> None:
    drivers = DriverRegistry()
    for protocol in (CompensatedRobot, CurrentSource):
        assert missing_abilities(drivers.abilities("kuka+rsi"), protocol) == []
    assert drivers.abilities("canopen+socketcan") is CurrentSource
    assert drivers.abilities("contact+serial") is ContactProbe


def test_a_description_with_its_two_needed_fields_is_a_whole_driver(lamps, dim) -> None:
    address = Address.parse("lamp://ceiling")
    assert lamps.open("light", address, dim).limits == {"watts": 5.0}
    assert hasattr(lamps.abilities("lamp"), "shine")
    assert lamps.findings("light", address, dim) == []
    assert lamps.controller_files("cell", address, dim) is None


def test_checks_and_controller_files_are_the_descriptions_own(lamps, dim) -> None:
    address = Address.parse("lamp+full://ceiling")
    assert lamps.findings("light", address, dim) == [
        Finding("cellar has no bulb"),
        Finding("dim", "more watts", "watts", warning=True),
    ]
    assert lamps.controller_files("cell 3", address, dim) == {"lamp.txt": "cell 3 ceiling"}


def test_without_a_set_up_check_limits_are_tried_by_opening(lamps, tmp_path) -> None:
    bright = Surroundings(WallClock(), tmp_path, {"watts": 60.0})
    assert lamps.findings("light", Address.parse("lamp://ceiling"), bright) == [Finding("too bright")]
    assert Finding("too bright") not in lamps.findings("light", Address.parse("lamp+full://ceiling"), bright)
    assert lamps.findings("light", Address.parse("lamp+full://"), bright) == [Finding("no host")]


@pytest.mark.parametrize(
    ("scheme", "words"),
    [
        ("lamp+old", "is not a DriverDescription"),
        ("lamp+gone", "cannot be loaded"),
        ("lmap", "did you mean 'lamp'"),
        ("x", "installed: "),
    ],
)
def test_what_yields_no_description_is_an_error_in_the_address(lamps, dim, scheme: str, words: str) -> None:
    (found,) = lamps.findings("light", Address.parse(f"{scheme}://ceiling"), dim)
    assert words in found.what
    assert not found.warning
