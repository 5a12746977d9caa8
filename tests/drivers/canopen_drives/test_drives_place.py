"""Addresses of drives."""

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Address, CurrentSource, Surroundings
from cellctl.devices.registry import DriverRegistry
from drivers.canopen_drives.description import CanPlace


def place(text):
    return CanPlace.of(Address.parse(text))


def test_the_same_settings_name_a_bus_of_each_interface():
    real = place("canopen+socketcan://can0?bitrate=500000&nodes=3,1,2")
    assert real.bus_settings() == {"interface": "socketcan", "channel": "can0", "bitrate": 500000}
    assert (real.nodes, real.current) == ((3, 1, 2), "6078")
    shared = place("canopen+udp-multicast://239.74.163.2:43113?nodes=1").bus_settings()
    assert shared == {
        "interface": "udp_multicast",
        "channel": "239.74.163.2",
        "port": 43113,
        "hop_limit": 0,
        "fd": False,
    }
    assert place("canopen+virtual://bench?nodes=1").bus_settings() == {"interface": "virtual", "channel": "bench"}


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("canopen+socketcan://?nodes=1", "names no bus"),
        ("canopen+socketcan://can0", "different node numbers"),
        ("canopen+socketcan://can0?nodes=", "different node numbers"),
        ("canopen+socketcan://can0?nodes=1,2,x", "different node numbers"),
        ("canopen+socketcan://can0?nodes=1,2,2", "different node numbers"),
        ("canopen+socketcan://can0?nodes=0", "different node numbers"),
        ("canopen+socketcan://can0?nodes=128", "different node numbers"),
        ("canopen+socketcan://can0?nodes=1&baud=5", "the setting 'baud' is not known"),
        ("canopen+socketcan://can0?nodes=1&bitrate=fast", "bitrate has to be"),
        ("canopen+socketcan://can0?nodes=1&bitrate=5000000", "bitrate has to be"),
        ("canopen+socketcan://can0:7?nodes=1", "needs a port, the other interfaces have none"),
        ("canopen+udp-multicast://239.74.163.2?nodes=1", "needs a port"),
        ("canopen+socketcan://can0?nodes=1&current=6079", "current has to be one of 6078, 6077, 6077/sqrt2"),
    ],
)
def test_an_error_in_the_address_is_named(text, what):
    with pytest.raises(ValueError, match=what):
        place(text)


@pytest.mark.parametrize("scheme", ["socketcan", "virtual"])
def test_the_driver_is_a_current_source_and_opens_nothing(tmp_path, scheme):
    address = Address.parse(f"canopen+{scheme}://can0?nodes=1,2,3,4,5,6")
    surroundings = Surroundings(WallClock(), tmp_path, {}, None)
    assert isinstance(DriverRegistry().open("drives", address, surroundings), CurrentSource)


def test_drives_have_no_limits(tmp_path):
    address = Address.parse("canopen+socketcan://can0?nodes=1")
    with pytest.raises(ValueError, match="only reads them"):
        DriverRegistry().open("drives", address, Surroundings(WallClock(), tmp_path, {"current": 1.0}, None))
