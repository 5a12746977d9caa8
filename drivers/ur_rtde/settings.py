"""Address and limits of a Universal Robots controller, and the resident program that follows from them."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Self, final

from cellctl.devices import Address, Finding, Surroundings, impossible_host

RTDE_PORT, DASHBOARD_PORT = 30004, 29999
EXAMPLE = "ur+rtde://192.168.0.10?contact_input=0"

FASTEST_DEG_S = 120.0
"""100 % of a move: the slowest joints of the e-Series and of CB3 (base and shoulder of the UR10 and larger)."""

MOVE_ACCELERATION_DEG_S2 = 80.0
"""PolyScope's default for MoveJ."""

STOP_ACCELERATION_DEG_S2 = 200.0
ASIDE_DEG = 0.3
"""Farthest from the line of a search, norm of the joint vector: more than the joints lag behind at its speed."""

SILENT_S = 0.2
"""The program stops when no new beat has come for so long; beats come every 20 ms."""

WATCHDOG_HZ = 4
"""The controller's own watch on the beat ends the program below this rate."""

TCP_SPEED_MM_S = 250.0
"""ISO 10218-1: highest speed of the TCP beside people."""

UNKNOWN_REACH_MM = 1850.0
"""The longest of the maker's arms (UR20)."""

_DEFAULTS = {"speed_percent": 30.0, "speed_deg_s": 2.0, "acceleration_deg_s2": 20.0, "travel_deg": 5.0}
_HIGHEST = {"speed_percent": 100.0, "acceleration_deg_s2": 80.0, "travel_deg": 10.0}


def ceilings(reach_mm: float | None) -> dict[str, float]:
    """The highest value of each limit. A joint vector of norm w moves the TCP by w · reach · √3 at most."""
    speed = math.degrees(TCP_SPEED_MM_S / ((reach_mm or UNKNOWN_REACH_MM) * math.sqrt(3)))
    return {**_HIGHEST, "speed_deg_s": math.floor(speed * 100) / 100}


@final
@dataclass(frozen=True, slots=True)
class UrLimits:
    """Limits of the cell file; defaults are low.

    `speed_percent`: of a move, of `FASTEST_DEG_S`; `speed_deg_s`, `acceleration_deg_s2`, `travel_deg`: of a search, for
    the Euclidean norm of the joint vector.
    """

    speed_percent: float
    speed_deg_s: float
    acceleration_deg_s2: float
    travel_deg: float

    @classmethod
    def of(cls, stated: Mapping[str, float], reach_mm: float | None) -> Self:
        """The limits; a missing one takes its default, or its ceiling if this is lower. Raises ValueError."""
        if found := findings(stated, reach_mm):
            raise ValueError("; ".join(finding.what for finding in found))
        highest = ceilings(reach_mm)
        return cls(**{name: stated.get(name, min(value, highest[name])) for name, value in _DEFAULTS.items()})


def findings(stated: Mapping[str, float], reach_mm: float | None) -> list[Finding]:
    """Errors in the limits of the cell file."""
    highest, found = ceilings(reach_mm), []
    for name, value in stated.items():
        if name not in highest:
            found.append(Finding(f"unknown limit '{name}'", f"there are {', '.join(highest)}", name))
        elif not 0 < value <= highest[name]:
            cure = f"give a number above 0 and up to {highest[name]:g}"
            found.append(Finding(f"limit {name} {value:g} is outside 0 … {highest[name]:g}", cure, name))
    return found


@final
@dataclass(frozen=True, slots=True)
class UrPlace:
    """Where the controller is, and to which of its digital inputs the probe's stop output is wired (None: to none).

    `contact_level`: of that input at a contact.
    """

    host: str
    port: int
    dashboard: int
    contact_input: int | None
    contact_level: bool

    @classmethod
    def of(cls, address: Address) -> Self:
        """The place in an address. Raises ValueError for an error in it."""
        if not address.host or address.path.strip("/"):
            raise ValueError(f"'{address}' has to name a host, and no path, as {EXAMPLE}")
        if why := impossible_host(address.host, reached=True):
            raise ValueError(f"'{address}': {why}")
        known = ("dashboard", "contact_input", "contact_level")
        if unknown := [name for name in address.query if name not in known]:
            raise ValueError(f"'{address}' has the unknown setting {', '.join(unknown)}; there are {', '.join(known)}")
        dashboard = _whole(address, "dashboard", 1, 65535)
        level = _whole(address, "contact_level", 0, 1)
        return cls(
            address.host,
            address.port or RTDE_PORT,
            DASHBOARD_PORT if dashboard is None else dashboard,
            _whole(address, "contact_input", 0, 7),
            level != 0,
        )


def _whole(address: Address, name: str, least: int, most: int) -> int | None:
    text = address.query.get(name)
    if text is None:
        return None
    if not re.fullmatch(r"\d{1,5}", text) or not least <= int(text) <= most:
        raise ValueError(f"'{address}': {name} is a whole number from {least} to {most}")
    return int(text)


SCRIPT = "cellctl.script"
INSTRUCTIONS = "README.txt"


@final
@dataclass(frozen=True, slots=True)
class ResidentProgram:
    """The text of the resident program, and its digest: two whole numbers, as two registers report them."""

    text: str
    digest: tuple[int, int]


def resident_program(cell: str, place: UrPlace, limits: UrLimits) -> ResidentProgram:
    """The resident program for the cell of that name. Its digest is over all but the cell's name and itself."""
    values = {
        "MOVE_SPEED": _radians(FASTEST_DEG_S * limits.speed_percent / 100),
        "MOVE_ACCELERATION": _radians(MOVE_ACCELERATION_DEG_S2),
        "SEARCH_SPEED": _radians(limits.speed_deg_s),
        "SEARCH_ACCELERATION": _radians(limits.acceleration_deg_s2),
        "TRAVEL": _radians(limits.travel_deg),
        "ASIDE": _radians(ASIDE_DEG),
        "STOP_ACCELERATION": _radians(STOP_ACCELERATION_DEG_S2),
        "CONTACT_INPUT": str(-1 if place.contact_input is None else place.contact_input),
        "CONTACT_LEVEL": str(place.contact_level),
        "SILENT": f"{SILENT_S:g}",
        "WATCHDOG_HZ": str(WATCHDOG_HZ),
    }
    body = _filled(_template(SCRIPT), values)
    hashed = hashlib.sha256(body.encode("ascii")).digest()
    digest = (int.from_bytes(hashed[:4], "big") >> 1, int.from_bytes(hashed[4:8], "big") >> 1)
    name = re.sub(r"[^ -~]|\"", "?", " ".join(cell.split()))
    places = {"CELL": name, "DIGEST_HIGH": str(digest[0]), "DIGEST_LOW": str(digest[1])}
    return ResidentProgram(_filled(body, places), digest)


def controller_files(cell: str, address: Address, surroundings: Surroundings) -> dict[str, str]:
    """File name → text of the files for the controller of the cell named `cell`.

    Raises ValueError for errors in the address or the limits.
    """
    place, limits = UrPlace.of(address), UrLimits.of(surroundings.limits, surroundings.reach_mm)
    program = resident_program(cell, place, limits)
    wiring = "none" if place.contact_input is None else f"digital input {place.contact_input}"
    instructions = _filled(_template(INSTRUCTIONS), {"CELL": cell, "WIRING": wiring, "HOST": place.host})
    return {SCRIPT: program.text, INSTRUCTIONS: instructions}


def _radians(degrees: float) -> str:
    """Rounded up: a job at the limit is within it."""
    return f"{math.ceil(math.radians(degrees) * 1e9) / 1e9:.9f}"


def _template(name: str) -> str:
    return files("drivers.ur_rtde").joinpath("controller_files", name).read_text(encoding="ascii")


def _filled(template: str, values: Mapping[str, str]) -> str:
    """The template with those of its `@NAME@` replaced that `values` has."""
    return re.sub(r"@([A-Z_]+)@", lambda found: values.get(found[1], found[0]), template)
