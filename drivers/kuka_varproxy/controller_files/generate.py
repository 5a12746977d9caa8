"""The controller's files for a cell with a variable proxy, made from templates, the address and the limits."""

from __future__ import annotations

import re
from importlib.resources import files

from cellctl.devices import Address, Surroundings
from drivers.kuka_varproxy import variables
from drivers.kuka_varproxy.line import ProxyPlace
from drivers.kuka_varproxy.readiness import MoveLimits

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
    return files("drivers.kuka_varproxy.controller_files").joinpath(name).read_text(encoding="ascii")


def _filled(template: str, places: dict[str, object]) -> str:
    """The template with every `@NAME@` replaced; ASCII, since KRL has no other characters."""
    text = re.sub(r"@([A-Z_]+)@", lambda found: str(places[found[1]]), template)
    return text.encode("ascii", "replace").decode("ascii")
