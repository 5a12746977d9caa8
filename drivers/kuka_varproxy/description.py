"""The description of this driver: its entry point."""

from __future__ import annotations

from cellctl.devices import Address, DriverDescription, Finding, Surroundings, TableRobot, host_places
from drivers.kuka_varproxy.controller_files.generate import controller_files
from drivers.kuka_varproxy.line import ProxyPlace
from drivers.kuka_varproxy.readiness import MoveLimits, findings
from drivers.kuka_varproxy.robot import VarProxyRobot


def open_robot(name: str, address: Address, surroundings: Surroundings) -> TableRobot:
    """The robot at `kuka+varproxy://HOST[:7000]`; opens nothing.

    `surroundings.limits` may set `speed_percent`. Raises ValueError for an error in the address or the limits.
    """
    limits, most = MoveLimits.of(surroundings.limits), surroundings.table_correction_deg
    return VarProxyRobot(name, ProxyPlace.of(address), surroundings.clock, limits, most)


def _findings(address: Address, surroundings: Surroundings) -> list[Finding]:
    return findings(surroundings.limits)


def _places(address: Address) -> frozenset[str]:
    """The proxy's port, and the controller, which another program may reach by EthernetKRL."""
    place = ProxyPlace.of(address)
    return host_places(place.host, place.port) | host_places(place.host)


DRIVER = DriverDescription(
    open_robot, VarProxyRobot, check_setup=_findings, controller_files=controller_files, places=_places
)
