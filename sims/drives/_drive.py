"""One drive: a CANopen node with its object dictionary, the state machine of CiA 402, transmit PDOs, and its motor."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, final

import canopen
from canopen import LocalNode, SdoAbortedError
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

from sims.drives._bus import KernelNetwork

NAME = "SIM CiA 402 drive"
FIRMWARE = "SIM 1.0"
TRANSMIT_PDOS = (1, 2)
INVALID = 0x8000_0000
MAPPED_AT_FIRST = 0x6041_0010
"""The statusword, 16 bit."""

STATUSWORD, CONTROLWORD, ERROR_CODE = 0x6041, 0x6040, 0x603F
POSITION, TORQUE, CURRENT = 0x6064, 0x6077, 0x6078
RATED_CURRENT, RATED_TORQUE = 0x6075, 0x6076

_TYPE_OF_BITS = {8: UNSIGNED8, 16: UNSIGNED16, 32: UNSIGNED32}

MAPPABLE = {STATUSWORD: 16, ERROR_CODE: 16, POSITION: 32, TORQUE: 16, CURRENT: 16}
"""Objects for a TPDO → bits."""

NOT_NOW = 0x0800_0022
"""Abort codes of CiA 301: not in the present state of the device; not mappable; longer than 8 bytes; value range."""
NOT_MAPPABLE, TOO_LONG, OUT_OF_RANGE = 0x0604_0041, 0x0604_0042, 0x0609_0030
_PRE_OPERATIONAL = "PRE-OPERATIONAL"
_LONGEST_BITS = 64

VOLTAGE_ENABLED = 0x10
REMOTE = 0x200
"""Bit 9: the controlword has effect."""

SHUTDOWN, SWITCH_ON, ENABLE_OPERATION = 0x06, 0x07, 0x0F
FAULT_RESET = 0x80

_COMMANDS = (
    (0x82, 0x00, "disable voltage"),
    (0x86, 0x02, "quick stop"),
    (0x87, 0x06, "shutdown"),
    (0x8F, 0x07, "switch on"),
    (0x8F, 0x0F, "enable operation"),
)
"""Mask, bits, command."""

NM_PER_A = 0.4
"""Torque constant of the motor, from which the rated torque follows."""
INCREMENTS_PER_DEG = 10_000
_GENERIC_ERROR = 0x01
_OPERATIONAL = "OPERATIONAL"


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


@final
class TransmitPdo:
    """TPDO `number` of a node."""

    def __init__(self, node: LocalNode, number: int) -> None:
        self._node = node
        self._parameter, self._mapping = 0x17FF + number, 0x19FF + number
        self._syncs = 0
        node.add_write_callback(self._check)

    def on_sync(self) -> tuple[int, bytes] | None:
        """COB-ID and data that are due with this SYNC; the node is operational."""
        every = self._read(self._parameter, 2)
        if not self._valid or not every:
            return None
        self._syncs = (self._syncs + 1) % every
        if self._syncs:
            return None
        data = b"".join(self._node.get_data(index, 0) for index in self._mapped())
        return self._read(self._parameter, 1) & 0x7FF, data

    @property
    def _valid(self) -> bool:
        return not self._read(self._parameter, 1) & INVALID

    def _mapped(self) -> list[int]:
        """The objects in the frame; each is of whole bytes."""
        return [self._read(self._mapping, entry) >> 16 for entry in range(1, self._read(self._mapping, 0) + 1)]

    def _read(self, index: int, subindex: int) -> int:
        return int.from_bytes(self._node.get_data(index, subindex), "little")

    def _check(self, *, index: int, subindex: int, od: object, data: bytes) -> None:
        """Refuse what a drive refuses: a change while the PDO is valid, or not in pre-operational."""
        if index not in (self._parameter, self._mapping):
            return
        value = int.from_bytes(data, "little")
        switches = index == self._parameter and subindex == 1
        if self._node.nmt.state != _PRE_OPERATIONAL or (self._valid and not switches):
            raise SdoAbortedError(NOT_NOW)
        if index == self._parameter:
            if subindex == 2 and value > 240:  # event-driven PDOs are not simulated
                raise SdoAbortedError(OUT_OF_RANGE)
        elif subindex == 0:
            self._check_length(value)
        else:
            self._check_entry(value)

    def _check_length(self, count: int) -> None:
        if count > 8:
            raise SdoAbortedError(TOO_LONG)
        if sum(self._read(self._mapping, entry) & 0xFF for entry in range(1, count + 1)) > _LONGEST_BITS:
            raise SdoAbortedError(TOO_LONG)

    def _check_entry(self, entry: int) -> None:
        if self._read(self._mapping, 0):
            raise SdoAbortedError(NOT_NOW)  # sub-index 0 must be 0 first
        if entry and MAPPABLE.get(entry >> 16) != entry & 0xFFFF:
            raise SdoAbortedError(NOT_MAPPABLE)


class State(IntEnum):
    """State, by its bits of the statusword."""

    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT = 0x08


_S = State
_TRANSITIONS = {
    (_S.SWITCH_ON_DISABLED, "shutdown"): _S.READY_TO_SWITCH_ON,
    (_S.READY_TO_SWITCH_ON, "switch on"): _S.SWITCHED_ON,
    (_S.READY_TO_SWITCH_ON, "enable operation"): _S.OPERATION_ENABLED,
    (_S.READY_TO_SWITCH_ON, "disable voltage"): _S.SWITCH_ON_DISABLED,
    (_S.READY_TO_SWITCH_ON, "quick stop"): _S.SWITCH_ON_DISABLED,
    (_S.SWITCHED_ON, "enable operation"): _S.OPERATION_ENABLED,
    (_S.SWITCHED_ON, "shutdown"): _S.READY_TO_SWITCH_ON,
    (_S.SWITCHED_ON, "disable voltage"): _S.SWITCH_ON_DISABLED,
    (_S.SWITCHED_ON, "quick stop"): _S.SWITCH_ON_DISABLED,
    (_S.OPERATION_ENABLED, "switch on"): _S.SWITCHED_ON,
    (_S.OPERATION_ENABLED, "shutdown"): _S.READY_TO_SWITCH_ON,
    (_S.OPERATION_ENABLED, "disable voltage"): _S.SWITCH_ON_DISABLED,
    (_S.OPERATION_ENABLED, "quick stop"): _S.QUICK_STOP_ACTIVE,
    (_S.QUICK_STOP_ACTIVE, "disable voltage"): _S.SWITCH_ON_DISABLED,
    (_S.QUICK_STOP_ACTIVE, "enable operation"): _S.OPERATION_ENABLED,
}


@final
class StateMachine:
    """One drive's. A command without a transition from the present state has no effect."""

    def __init__(self) -> None:
        self.state = State.SWITCH_ON_DISABLED
        self._controlword = 0

    @property
    def statusword(self) -> int:
        """Object 0x6041."""
        powered = self.state & 0x01 or self.state is State.QUICK_STOP_ACTIVE
        return self.state | REMOTE | (VOLTAGE_ENABLED if powered else 0)

    def control(self, word: int) -> None:
        """Object 0x6040. A rising edge of bit 7 ends a fault."""
        rises = word & ~self._controlword & FAULT_RESET
        self._controlword = word
        if self.state is State.FAULT:
            self.state = State.SWITCH_ON_DISABLED if rises else State.FAULT
            return
        command = next((name for mask, bits, name in _COMMANDS if word & mask == bits), "")
        self.state = _TRANSITIONS.get((self.state, command), self.state)

    def fail(self) -> None:
        """The drive has a fault: its power is off."""
        self.state = State.FAULT


@final
@dataclass(frozen=True, slots=True)
class Motor:
    """True mean current (A) and joint reading (deg) now, whether the brake is closed, and since when the arm stands.

    `rated_a`: rated current; `noise`: draws the error of one current, as share of the rated one.
    """

    current: Callable[[], float]
    reading: Callable[[], float]
    brake_closed: Callable[[], bool]
    standing_since: Callable[[], int | None]
    rated_a: float
    noise: Callable[[], float]


@final
class Drive:
    """Node `number` of `network`, off until `boot`.

    The robot's controller commands it: it enables the operation before its motor moves, and disables it when the
    brake has closed. A master on the bus can command it too; the last command counts.
    """

    def __init__(self, number: int, serial: int, motor: Motor, network: KernelNetwork) -> None:
        self.number = number
        self._serial = serial
        self._motor = motor
        self._network = network
        self._node: canopen.LocalNode | None = None
        self._machine = StateMachine()
        self._pdos: list[TransmitPdo] = []
        self._obeyed: tuple[bool, int | None] | None = None
        self._rated_ma = round(motor.rated_a * 1e3)

    def boot(self) -> None:
        """Switch it on: all settings are as delivered, boot-up is sent, the state is pre-operational."""
        rated_mnm = round(self._motor.rated_a * NM_PER_A * 1e3)
        node = canopen.LocalNode(self.number, objects_of(self.number, self._serial, self._rated_ma, rated_mnm))
        self._node, self._machine = node, StateMachine()
        self._pdos = [TransmitPdo(node, number) for number in TRANSMIT_PDOS]
        node.add_read_callback(self._read)
        node.add_write_callback(self._write)
        self._network[self.number] = node
        node.nmt.state = "INITIALISING"
        node.nmt.state = "PRE-OPERATIONAL"

    def shut(self) -> None:
        """Switch it off. The controller enables it again with its next motion, not before."""
        if self._node is not None:
            self._node.nmt.stop_heartbeat()
            del self._network[self.number]
            self._obeyed = self._motor.brake_closed(), self._motor.standing_since()
        self._node = None

    def on_sync(self) -> list[tuple[int, bytes]]:
        """The frames that this drive sends for a SYNC."""
        if self._node is None or self._node.nmt.state != _OPERATIONAL:
            return []
        return [frame for pdo in self._pdos if (frame := pdo.on_sync())]

    def on_controlword(self, data: bytes) -> None:
        """RPDO1."""
        if self._node is not None and self._node.nmt.state == _OPERATIONAL and len(data) >= 2:
            self._control(int.from_bytes(data[:2], "little"))

    def fail(self, code: int) -> None:
        """A fault: power off, EMCY."""
        if self._node is not None:
            self._machine.fail()
            self._put_error(code, _GENERIC_ERROR)
            self._node.emcy.send(code, _GENERIC_ERROR)

    def _control(self, word: int) -> None:
        self._obey_controller()
        was_fault = self._machine.state is State.FAULT
        self._machine.control(word)
        if self._node is not None and was_fault and self._machine.state is not State.FAULT:
            self._put_error(0, 0)
            self._node.emcy.reset()

    def _put_error(self, code: int, register: int) -> None:
        if self._node is not None:
            self._node.set_data(ERROR_CODE, 0, struct.pack("<H", code))
            self._node.set_data(0x1001, 0, bytes([register]))

    def _read(self, *, index: int, subindex: int, od: Any) -> int | None:
        """The value of an object that changes by itself; None: as it was stored."""
        if index == STATUSWORD:
            self._obey_controller()
            return self._machine.statusword
        if index == POSITION:
            return round(self._motor.reading() * INCREMENTS_PER_DEG)
        if index in (CURRENT, TORQUE):  # the drive works out its torque from the current
            return self._per_mille()
        return None

    def _per_mille(self) -> int:
        self._obey_controller()
        share = self._motor.current() / self._motor.rated_a + self._motor.noise()
        return round(1e3 * share) if self._machine.state is State.OPERATION_ENABLED else 0

    def _obey_controller(self) -> None:
        """What the robot's controller has commanded since: the arm has moved, or the brake has closed."""
        closed = self._motor.brake_closed()
        now = closed, self._motor.standing_since()
        if now == self._obeyed:
            return
        self._obeyed = now
        for word in (SWITCH_ON,) if closed else (SHUTDOWN, SWITCH_ON, ENABLE_OPERATION):
            self._machine.control(word)

    def _write(self, *, index: int, subindex: int, od: Any, data: bytes) -> None:
        if index == CONTROLWORD:
            self._control(int.from_bytes(data, "little"))
