"""What a device can do, where it is, and what can go wrong: the seam between campaigns and drivers."""

from cellctl.devices.addresses import Address
from cellctl.devices.errors import (
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUnreachable,
    LimitExceeded,
    NoContact,
    ProbeNotOpen,
)
from cellctl.devices.protocols import (
    Contact,
    ContactProbe,
    Device,
    Guard,
    Health,
    Identity,
    JointReadings,
    Listener,
    SearchEnd,
    SearchingRobot,
    SearchResult,
    Surroundings,
)
from cellctl.devices.tables import ControllerTable, TableInfo, TableRow, TableState, TableStore

__all__ = [
    "Address",
    "Contact",
    "ContactProbe",
    "ControllerTable",
    "Device",
    "DeviceError",
    "DeviceFault",
    "DeviceLost",
    "DeviceRefused",
    "DeviceUnreachable",
    "Guard",
    "Health",
    "Identity",
    "JointReadings",
    "LimitExceeded",
    "Listener",
    "NoContact",
    "ProbeNotOpen",
    "SearchEnd",
    "SearchResult",
    "SearchingRobot",
    "Surroundings",
    "TableInfo",
    "TableRow",
    "TableState",
    "TableStore",
]
