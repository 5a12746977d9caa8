"""The description of this driver: its entry point, and the checks of the cell file's limits and addresses."""

from __future__ import annotations

import ipaddress
from pathlib import Path

from cellctl.devices import Address, CompensatedRobot, DriverDescription, Finding, Surroundings, host_places
from drivers.kuka_rsi.controller_files.generate import controller_files
from drivers.kuka_rsi.cyclic.limits import (
    ONLINE_CEILINGS,
    SEARCH_NEEDS,
    OnlineLimits,
    SearchLimits,
    ceilings,
    limit_errors,
    of_each,
    online_limit_errors,
)
from drivers.kuka_rsi.ethernet_config import read_ethernet_config
from drivers.kuka_rsi.robot.kuka_robot import KukaRobot
from drivers.kuka_rsi.settings import RsiSettings


def findings(address: Address, surroundings: Surroundings) -> list[Finding]:
    """Errors in the limits, and warnings about limits and address. The address itself must have no error."""
    limits, reach_mm = surroundings.limits, surroundings.reach_mm
    search, corrections = of_each(limits)
    errors = limit_errors(search, reach_mm) | online_limit_errors(corrections)
    name, axiscorr = "online_correction_deg", search.get("correction_deg", ceilings(reach_mm)["correction_deg"])
    highest = corrections.get(name, OnlineLimits().online_correction_deg)
    if name not in errors and highest > axiscorr:
        errors[name] = f"{name} {highest:g} is above correction_deg {axiscorr:g}, where AXISCORR clamps silently"
    found = [Finding(what, _cure(name, reach_mm), name) for name, what in errors.items()]
    for name, need in SEARCH_NEEDS.items():
        if name in limits and name not in errors and limits[name] > need:
            what = f"robot limit {name}: {limits[name]:g} is more than a search needs ({need:g})"
            found.append(Finding(what, f"give {need:g} or less, or leave it out", name, warning=True))
    return found + _about_telegrams(address)


def _cure(name: str, reach_mm: float | None) -> str:
    highest = ceilings(reach_mm) | ONLINE_CEILINGS
    if name in highest:
        return f"give a number above 0 and up to {highest[name]:g}"
    return f"remove it; a robot's limits are {', '.join(highest)}"


def _about_telegrams(address: Address) -> list[Finding]:
    """A warning if telegrams are expected from the EKI address: RSI has another one, on its own subnet."""
    host = address.query.get("eki", "").rpartition(":")[0].strip("[]")
    if address.query.get("controller") or _is_loopback(host):
        return []
    what = f"telegrams are taken from {host} alone, the EKI address, and RSI needs a subnet of its own"
    return [Finding(what, "add &controller=IP, the controller's address on the RSI network", warning=True)]


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def open_robot(name: str, address: Address, surroundings: Surroundings) -> CompensatedRobot:
    """The robot at `kuka+rsi://BIND_HOST:BIND_PORT?ethernet=FILE&eki=HOST:PORT[&mode=absolute&cycle=ipo_fast]`.

    Opens nothing. `mode` is `absolute` or `relative`, `cycle` is `ipo_fast` (4 ms) or `ipo` (12 ms), both as the
    controller's program passes them to RSI_ON; `correction` and `stop` are tags (AK, Stop); `controller` is the address
    that telegrams come from, if it is not the host of `eki`; `tolerance` is the ETHERNET object's `Timeout`.
    `surroundings.limits` may set `correction_deg`, `speed_deg_s`, `acceleration_deg_s2`, `jerk_deg_s3` and
    `travel_deg`, up to ceilings that follow from `surroundings.reach_mm`, and those of an on-line correction:
    `online_correction_deg`, `online_rate_deg_s`, `online_acceleration_deg_s2`. Raises ValueError for an error in the
    address, an unknown limit or one above its ceiling.
    """
    search, corrections = of_each(surroundings.limits)
    limits = SearchLimits.from_settings(search, surroundings.reach_mm)
    online = OnlineLimits.from_settings(corrections)
    most = surroundings.table_correction_deg
    return KukaRobot(name, RsiSettings.of(address, surroundings.folder), surroundings.clock, limits, online, most)


def check_address(address: Address, folder: Path) -> list[str]:
    """Every error in the address and in the Ethernet configuration that it names; opens no socket.

    `folder`: base of relative paths in the address. Each entry is a line for a person, `file:line: what`.
    """
    try:
        settings = RsiSettings.of(address, folder)
    except ValueError as error:
        return [str(error)]
    return read_ethernet_config(settings).errors


def _places(address: Address) -> frozenset[str]:
    """The port of EthernetKRL, and the controller, which a variable proxy reaches by another port."""
    settings = RsiSettings.of(address, Path())
    return host_places(*settings.eki) | host_places(settings.eki[0]) | host_places(settings.heard)


DRIVER = DriverDescription(open_robot, KukaRobot, check_address, findings, controller_files, _places)
