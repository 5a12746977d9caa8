"""The description of this driver: its entry point; the controller's files from templates, address and limits."""

from __future__ import annotations

import re
from importlib.resources import files

from cellctl.devices import Address, DriverDescription, Finding, Surroundings, TableRobot, host_places
from drivers.kuka_varproxy import variables
from drivers.kuka_varproxy.line import ProxyPlace
from drivers.kuka_varproxy.readiness import MoveLimits, findings
from drivers.kuka_varproxy.robot import VarProxyRobot

KRL_FILES = ("cellctl_kvp.src", "cellctl_kvp.dat")
INSTRUCTIONS = "README.txt"


def controller_files(cell: str, address: Address, surroundings: Surroundings) -> dict[str, str]:
    """File name → text of the files for the controller of the cell named `cell`.

    Raises ValueError for errors in the address or the limits.
    """
    place, limits = ProxyPlace.of(address), MoveLimits.of(surroundings.limits)
    places = {
        "CELL": " ".join(cell.split()),
        "VERSION": variables.VERSION,
        "FLAG": variables.FLAG_STOP,
        "TIMER": variables.TIMER,
        "INTERRUPT_STOP": variables.INTERRUPT_STOP,
        "INTERRUPT_SILENCE": variables.INTERRUPT_SILENCE,
        "BANKS": variables.BANKS,
        "ROWS": variables.MOST_ROWS,
        "PERCENT": int(limits.speed_percent),
        "SILENCE": f"{variables.SILENCE_MS / 1000:g}",
        "HOST": place.host,
        "PORT": place.port,
    }
    return {name: _filled(_template(name), places) for name in (*KRL_FILES, INSTRUCTIONS)}


def _template(name: str) -> str:
    return files("drivers.kuka_varproxy").joinpath("controller_files", name).read_text(encoding="ascii")


def _filled(template: str, places: dict[str, object]) -> str:
    """The template with every `@NAME@` replaced; ASCII, since KRL has no other characters."""
    text = re.sub(r"@([A-Z_]+)@", lambda found: str(places[found[1]]), template)
    return text.encode("ascii", "replace").decode("ascii")


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
