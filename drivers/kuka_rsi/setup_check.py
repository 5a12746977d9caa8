"""Checks the cell file's limits against their ceilings and the needs of a search, and the telegrams' address."""

from __future__ import annotations

import ipaddress

from cellctl.devices import Address, Finding, Surroundings
from drivers.kuka_rsi.cyclic.limits import SEARCH_NEEDS, ceilings, limit_errors
from drivers.kuka_rsi.cyclic.online_limits import ONLINE_CEILINGS, of_each, online_limit_errors


def findings(address: Address, surroundings: Surroundings) -> list[Finding]:
    """Errors in the limits, and warnings about limits and address. The address itself must have no error."""
    limits, reach_mm = surroundings.limits, surroundings.reach_mm
    search, corrections = of_each(limits)
    errors = limit_errors(search, reach_mm) | online_limit_errors(corrections)
    name, axiscorr = "online_correction_deg", search.get("correction_deg", ceilings(reach_mm)["correction_deg"])
    if name not in errors and corrections.get(name, 0.0) > axiscorr:
        errors[name] = (
            f"{name} {corrections[name]:g} is above correction_deg {axiscorr:g}, where AXISCORR clamps silently"
        )
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
