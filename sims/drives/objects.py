"""The object dictionary of a simulated drive: CiA 301 communication objects, CiA 402 drive objects."""

from __future__ import annotations

import canopen
from canopen.objectdictionary import (
    INTEGER16,
    INTEGER32,
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
    VISIBLE_STRING,
    ObjectDictionary,
    ODRecord,
    ODVariable,
)

NAME = "SIM CiA 402 drive"
FIRMWARE = "SIM 1.0"
TRANSMIT_PDOS = (1, 2)
INVALID = 0x8000_0000
NO_RTR = 0x4000_0000
MAPPED_AT_FIRST = 0x6041_0010
"""The statusword, 16 bit."""

STATUSWORD, CONTROLWORD, ERROR_CODE = 0x6041, 0x6040, 0x603F
POSITION, TORQUE, CURRENT = 0x6064, 0x6077, 0x6078
RATED_CURRENT, RATED_TORQUE = 0x6075, 0x6076

_TYPE_OF_BITS = {8: UNSIGNED8, 16: UNSIGNED16, 32: UNSIGNED32}

MAPPABLE = {STATUSWORD: 16, ERROR_CODE: 16, POSITION: 32, TORQUE: 16, CURRENT: 16}
"""Objects for a TPDO → bits."""


def objects_of(node: int, serial: int, rated_ma: int, rated_mnm: int) -> ObjectDictionary:
    """The dictionary of one drive with these rated values, 0x6075 in mA and 0x6076 in mN·m."""
    found = canopen.ObjectDictionary()
    plain: list[tuple[int, str, int, str, int | str]] = [
        (0x1000, "Device type", UNSIGNED32, "const", 0x0002_0192),
        (0x1001, "Error register", UNSIGNED8, "ro", 0),
        (0x1008, "Manufacturer device name", VISIBLE_STRING, "const", NAME),
        (0x100A, "Manufacturer software version", VISIBLE_STRING, "const", FIRMWARE),
        (0x1017, "Producer heartbeat time", UNSIGNED16, "rw", 0),
        (ERROR_CODE, "Error code", UNSIGNED16, "ro", 0),
        (CONTROLWORD, "Controlword", UNSIGNED16, "rw", 0),
        (STATUSWORD, "Statusword", UNSIGNED16, "ro", 0),
        (POSITION, "Position actual value", INTEGER32, "ro", 0),
        (RATED_CURRENT, "Motor rated current", UNSIGNED32, "ro", rated_ma),
        (RATED_TORQUE, "Motor rated torque", UNSIGNED32, "ro", rated_mnm),
        (TORQUE, "Torque actual value", INTEGER16, "ro", 0),
        (CURRENT, "Current actual value", INTEGER16, "ro", 0),
    ]
    for index, name, kind, access, value in plain:
        found.add_object(_variable(name, index, 0, kind, access, value))
    identity = [("Vendor-ID", 0), ("Product code", 402), ("Revision number", 0x0001_0000), ("Serial number", serial)]
    found.add_object(_record("Identity object", 0x1018, [(name, 32, value) for name, value in identity], "const"))
    found.add_object(_record("RPDO1 parameter", 0x1400, [("COB-ID", 32, 0x200 + node), ("Type", 8, 255)], "const"))
    found.add_object(_record("RPDO1 mapping", 0x1600, [("Entry 1", 32, 0x6040_0010)], "const"))
    for number in TRANSMIT_PDOS:
        cob = 0x80 + 0x100 * number + node | (0 if number == 1 else INVALID)
        settings = [("COB-ID", 32, cob), ("Transmission type", 8, 1)]
        found.add_object(_record(f"TPDO{number} parameter", 0x17FF + number, settings, "rw"))
        entries = [(f"Entry {entry}", 32, MAPPED_AT_FIRST if entry == 1 else 0) for entry in range(1, 9)]
        mapping = _record(f"TPDO{number} mapping", 0x19FF + number, entries, "rw")
        mapping[0].access_type, mapping[0].value = "rw", 1
        found.add_object(mapping)
    return found


def _record(name: str, index: int, members: list[tuple[str, int, int]], access: str) -> ODRecord:
    """A record: name, bits and value of sub-index 1, 2 …; sub-index 0 is their number."""
    record = ODRecord(name, index)
    record.add_member(_variable("Highest sub-index", index, 0, UNSIGNED8, "const", len(members)))
    for subindex, (member, bits, value) in enumerate(members, 1):
        record.add_member(_variable(member, index, subindex, _TYPE_OF_BITS[bits], access, value))
    return record


def _variable(name: str, index: int, subindex: int, kind: int, access: str, value: int | str) -> ODVariable:
    variable = ODVariable(name, index, subindex)
    variable.data_type, variable.access_type = kind, access
    variable.value = value  # type: ignore[assignment]  # a text for VISIBLE_STRING
    return variable
