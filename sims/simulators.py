"""The simulators that are installed, found by their entry points."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.metadata import entry_points
from typing import final
from urllib.parse import urlsplit

from sims.faults import FaultCatalogue
from sims.scene.safety import SCENE_FAULTS
from sims.simulator import Simulator

GROUP = "cellctl.simulators"


class BadSimulator(Exception):
    """An installed simulator cannot be used; the text names it and the reason."""


@final
class Simulators:
    """Descriptions of simulators, no scheme, section or fault twice. Raises BadSimulator."""

    def __init__(self, descriptions: Iterable[Simulator]) -> None:
        self.all = tuple(descriptions)
        self.faults = (*SCENE_FAULTS, *(kind for one in self.all for kind in one.faults))
        self._by_scheme = {scheme: one for one in self.all for scheme in one.schemes}
        _once("scheme", [scheme for one in self.all for scheme in one.schemes])
        _once("section", [*GENERAL, *(one.section for one in self.all if one.section)])
        _once("fault", [kind.name for kind in self.faults])

    def of(self, address: str) -> Simulator | None:
        """The one that stands in for devices of such an address."""
        return self._by_scheme.get(urlsplit(address).scheme)

    def catalogue(self, addresses: Iterable[str]) -> FaultCatalogue:
        """All faults, and the events of the devices at these addresses."""
        here = [one for address in addresses if (one := self.of(address))]
        return FaultCatalogue(self.faults, [event for one in here for event in one.events])

    def problems(self, addresses: Mapping[str, str]) -> list[str]:
        """What keeps the devices, name → address, from being simulated, each begun by its place in the cell file."""
        found = []
        for device, address in addresses.items():
            one = self.of(address)
            if one is None:
                scheme, known = urlsplit(address).scheme, " and ".join(sorted(self._by_scheme))
                found.append(f"devices.{device}: there is no simulator for '{scheme}', only for {known}")
            else:
                found += [f"devices.{device}: {error}" for error in one.address_errors(address)]
        for one in self.all:
            devices = [device for device, address in addresses.items() if self.of(address) is one]
            if one.most is not None and len(devices) > one.most:
                number, kind = "one device" if one.most == 1 else f"{one.most} devices", " or ".join(one.schemes)
                found.append(f"devices.{devices[one.most]}: only {number} of {kind} can be simulated")
        return found


GENERAL = ("seed", "clock", "errors", "payload", "commissioning", "faults")
"""Keys of `simulate:` that belong to no device."""


@cache
def installed() -> Simulators:
    """Of every installed package. Raises BadSimulator."""
    found = []
    for point in sorted(entry_points(group=GROUP), key=lambda point: point.name):
        try:
            description = point.load()
        except Exception as error:  # another package's code: whatever it raises is reported, with its name
            raise BadSimulator(f"the simulator '{point.name}' ({point.value}) cannot be loaded: {error!r}") from error
        if not isinstance(description, Simulator):
            raise BadSimulator(f"the simulator '{point.name}' ({point.value}) is no sims.simulator.Simulator")
        found.append(description)
    return Simulators(found)


def _once(what: str, names: Sequence[str]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise BadSimulator(f"two installed simulators have the {what} '{twice[0]}'; uninstall one of them")
