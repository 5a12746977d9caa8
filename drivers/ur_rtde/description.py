"""The description of this driver: its entry point."""

from __future__ import annotations

from cellctl.devices import Address, CompensatedRobot, DriverDescription, Finding, Surroundings, host_places
from drivers.ur_rtde.robot import TablePlace, UrRobot
from drivers.ur_rtde.settings import UrLimits, UrPlace, controller_files, findings, resident_program


def open_robot(name: str, address: Address, surroundings: Surroundings) -> CompensatedRobot:
    """The robot at `ur+rtde://HOST[:30004]?contact_input=N[&contact_level=0&dashboard=PORT]`; opens nothing.

    `contact_input`: the controller's digital input that the probe's stop output is wired to. `surroundings.limits` may
    set `speed_percent` and, of a search, `speed_deg_s`, `acceleration_deg_s2`, `travel_deg`. Raises ValueError for an
    error in the address or the limits.
    """
    place, limits = UrPlace.of(address), UrLimits.of(surroundings.limits, surroundings.reach_mm)
    folder = surroundings.state or surroundings.folder / "host_tables"
    tables = TablePlace(folder, surroundings.table_correction_deg)
    return UrRobot(name, place, resident_program("", place, limits).digest, surroundings.clock, limits, tables)


def _findings(address: Address, surroundings: Surroundings) -> list[Finding]:
    found = findings(surroundings.limits, surroundings.reach_mm)
    if UrPlace.of(address).contact_input is None:
        what = (
            "the probe stops the robot by this computer alone: its stop output is wired to no input of the controller"
        )
        found.append(Finding(what, "wire it, and write contact_input=N into the robot's address", warning=True))
    return found


def _places(address: Address) -> frozenset[str]:
    place = UrPlace.of(address)
    return host_places(place.host, place.port) | host_places(place.host)


DRIVER = DriverDescription(
    open_robot, UrRobot, check_setup=_findings, controller_files=controller_files, places=_places
)
