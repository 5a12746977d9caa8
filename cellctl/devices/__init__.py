"""Protocols, addresses and errors of devices: the interface between campaigns and drivers."""

from cellctl.devices.addresses import Address
from cellctl.devices.conditions import Conditions
from cellctl.devices.driver import DriverDescription
from cellctl.devices.errors import (
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    DeviceUncertain,
    DeviceUnreachable,
    LimitExceeded,
    NoContact,
    ProbeNotOpen,
)
from cellctl.devices.protocols import (
    Contact,
    ContactProbe,
    Device,
    Finding,
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
from cellctl.devices.tables import CompensatedRobot, ControllerTable, TableInfo, TableRow, TableState, TableStore

__all__ = [
    "Address",
    "CompensatedRobot",
    "Conditions",
    "Contact",
    "ContactProbe",
    "ControllerTable",
    "Device",
    "DeviceError",
    "DeviceFault",
    "DeviceLost",
    "DeviceRefused",
    "DeviceUncertain",
    "DeviceUnreachable",
    "DriverDescription",
    "Finding",
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
