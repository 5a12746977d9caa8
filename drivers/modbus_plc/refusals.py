"""Exceptions of the Modbus protocol, turned into errors with a cure.

Source: MODBUS Application Protocol Specification V1.1b3, chapter 7.
"""

from __future__ import annotations

from cellctl.devices import DeviceBusy, DeviceError, DeviceFault, DeviceLost, DeviceRefused

_MAP_CURE = "compare the PLC's Modbus server with the I/O map in docs/connecting-a-plc.md"


def refusal(device: str, doing: str, code: int) -> DeviceError:
    """The error for an exception response; `doing`: the request in words."""
    match code:
        case 1:
            return DeviceRefused(device, f"{doing}: the PLC does not know this function (exception 01)", _MAP_CURE)
        case 2:
            return DeviceRefused(device, f"{doing}: the PLC does not have this address (exception 02)", _MAP_CURE)
        case 3:
            return DeviceRefused(device, f"{doing}: the PLC does not take this value (exception 03)", _MAP_CURE)
        case 4:
            cure = "look at the PLC's diagnosis: its program or one of its modules has failed"
            return DeviceFault(device, f"{doing}: the PLC failed (exception 04)", cure)
        case 5 | 6:
            return DeviceBusy(device, f"{doing}: the PLC is busy (exception {code:02X})", "ask again later")
        case 0x0A | 0x0B:
            cure = "check 'unit' in the address; a PLC without a gateway usually has unit 1"
            return DeviceLost(device, f"{doing}: the gateway finds no PLC of this unit (exception {code:02X})", cure)
    return DeviceRefused(device, f"{doing}: the PLC refused (exception {code:02X})", _MAP_CURE)
