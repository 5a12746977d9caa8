"""The description of this driver: its entry point."""

from __future__ import annotations

from cellctl.devices import Address, DriverDescription, PointSource, Surroundings
from drivers.geocom_tracker.polar_points import PROFILES
from drivers.geocom_tracker.tracker import GeocomTracker
from drivers.serial_port import SerialPlace

_DEFAULT_BAUD = 115_200
_DEFAULT_ACCURACY = "tdra6000"
_SETTINGS = ("accuracy", "baud")


def open_tracker(name: str, address: Address, surroundings: Surroundings) -> PointSource:
    """The laser station `name` at `geocom+serial:///dev/ttyUSB0?baud=115200&accuracy=tdra6000`; `connect` opens it.

    Raises ValueError for an address without a port, with a host, an unknown setting or an unknown accuracy, or for
    any limit.
    """
    if surroundings.limits:
        raise ValueError("an instrument has no limits; those of a transfer are the robot's")
    place = SerialPlace.of(address, _DEFAULT_BAUD)
    unknown = sorted(set(address.query) - set(_SETTINGS))
    if unknown:
        raise ValueError(f"'{address}': the setting '{unknown[0]}' is not known; there are {', '.join(_SETTINGS)}")
    accuracy = PROFILES.get(address.query.get("accuracy", _DEFAULT_ACCURACY))
    if accuracy is None:
        raise ValueError(f"'{address}': no accuracy of that name; known are {', '.join(PROFILES)}")
    return GeocomTracker(name, place, surroundings.clock, accuracy)


DRIVER = DriverDescription(open_tracker, PointSource)
