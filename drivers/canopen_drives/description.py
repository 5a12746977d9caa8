"""The description of this driver: its entry points."""

from __future__ import annotations

from cellctl.devices import Address, CurrentSource, DriverDescription, Finding, Surroundings
from drivers.canopen_drives.place import CanPlace

_NO_LIMITS = "drives have no limits: this driver only reads them"


def open_drives(name: str, address: Address, surroundings: Surroundings) -> CurrentSource:
    """The drives at `canopen+socketcan://can0?bitrate=1000000&nodes=1,2,3,4,5,6[&current=6078]`; `connect` opens them.

    Schemes: `canopen+` and an interface of python-can. `nodes`: node numbers in the order of the axes; `current`: the
    object that carries the current (docs/connecting-drives.md). Raises ValueError for an error in the address.
    """
    from drivers.canopen_drives.drives import CanopenDrives  # canopen and python-can, where they are used

    if surroundings.limits:
        raise ValueError(_NO_LIMITS)
    return CanopenDrives(name, CanPlace.of(address), surroundings.clock)


def _places(address: Address) -> set[str]:
    return {f"bus {CanPlace.of(address)}"}


def _findings(address: Address, surroundings: Surroundings) -> list[Finding]:
    found = [Finding(_NO_LIMITS, "leave it out", limit=name) for name in surroundings.limits]
    nodes, axes = len(CanPlace.of(address).nodes), surroundings.axes
    if axes is not None and nodes != axes:
        what = f"nodes names {nodes} drive{'s' * (nodes != 1)}, and the robot has {axes} axes"
        found.append(Finding(what, "name the node of each axis, A1 first"))
    return found


DRIVER = DriverDescription(open_drives, CurrentSource, check_setup=_findings, places=_places)
