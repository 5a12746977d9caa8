"""One drive of the bus: its objects by SDO, its state, heartbeat, EMCY messages and process data."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import canopen
from canopen.emcy import EmcyError

from cellctl.clock import Clock
from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused
from drivers.canopen_drives.place import CURRENTS

HEARTBEAT_MS = 1000
_ANSWER_S = 5.0
"""Wall time after which a node that does not answer is taken for dead; a bound only: it has answered before."""

_DRIVE_PROFILE = 402
_MAPPING = (0x6064_0020, 0x6078_0010, 0x6077_0010)
"""TPDO1: position, current, torque."""
_NOT_VALID = 0x8000_0000
_EACH_SYNC = 1

_OLDEST_HEARTBEAT_S = 2.5
_FRAME = struct.Struct("<ihh")
"""TPDO1: position 0x6064, current 0x6078, torque 0x6077."""

_OPERATIONAL, _BOOT_UP = 5, 0
_NMT_STATES = {4: "stopped", 127: "pre-operational"}

OPERATION_ENABLED = "operation enabled"
FAULT = "fault"
_STATES = (
    (0x4F, 0x00, "not ready to switch on"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, OPERATION_ENABLED),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction active"),
    (0x4F, 0x08, FAULT),
)
"""Mask, bits and state of a statusword (CiA 402)."""


@final
@dataclass(frozen=True, slots=True)
class DriveData:
    """Rated current, A; name (0x1008), software version (0x100A), serial number (0x1018:4), empty where absent."""

    rated_a: float
    name: str
    firmware: str
    serial: str


@final
class DriveObjects:
    """The objects of one node. Reading and writing raises DeviceRefused (no such object …), DeviceLost (no answer)."""

    def __init__(self, device: str, title: str, number: int, node: canopen.RemoteNode) -> None:
        self._device, self._title = device, title
        self._number, self._sdo = number, node.sdo
        self._sdo.RESPONSE_TIMEOUT = _ANSWER_S

    def set_up(self) -> DriveData:
        """Check that it is a drive, map its TPDO1, start its heartbeat, read its rated values; in pre-operational.

        Raises also DeviceFault (rated values of 0).
        """
        profile = self._read(0x1000) & 0xFFFF
        if profile != _DRIVE_PROFILE:
            what = f"{self._title} has profile {profile}, it is no drive of CiA 402"
            raise DeviceRefused(self._device, what, "check the nodes in the address")
        self._map()
        self._write(0x1017, 0, HEARTBEAT_MS, 2)
        rated_ma, rated_mnm = self._read(0x6075), self._read(0x6076)
        if not rated_ma or not rated_mnm:
            what = f"{self._title} has a rated current of {rated_ma} mA and a rated torque of {rated_mnm} mN·m"
            cure = "enter the motor's data in the drive (0x6075, 0x6076): currents are sent in per mille of them"
            raise DeviceFault(self._device, what, cure)
        return DriveData(rated_ma * 1e-3, self._text(0x1008), self._text(0x100A), self._serial())

    def statusword(self) -> int:
        """Object 0x6041 now."""
        return self._read(0x6041)

    def error_code(self) -> int:
        """Object 0x603F now."""
        return self._read(0x603F)

    def _map(self) -> None:
        """TPDO1 with each SYNC. Many drives need this order: invalid, no entries, entries, number, type, valid."""
        self._write(0x1800, 1, _NOT_VALID | 0x180 + self._number, 4)
        self._write(0x1A00, 0, 0, 1)
        for entry, mapped in enumerate(_MAPPING, 1):
            self._write(0x1A00, entry, mapped, 4)
        self._write(0x1A00, 0, len(_MAPPING), 1)
        self._write(0x1800, 2, _EACH_SYNC, 1)
        self._write(0x1800, 1, 0x180 + self._number, 4)

    def _read(self, index: int, subindex: int = 0) -> int:
        return int.from_bytes(self._upload(index, subindex), "little")

    def _upload(self, index: int, subindex: int = 0) -> bytes:
        try:
            return bytes(self._sdo.upload(index, subindex))
        except canopen.SdoAbortedError as abort:
            raise self._refused(f"0x{index:04X}:{subindex} cannot be read", abort) from abort
        except canopen.SdoCommunicationError as error:
            raise silent(self._device, self._title, "no answer to SDO") from error

    def _write(self, index: int, subindex: int, value: int, size: int) -> None:
        try:
            self._sdo.download(index, subindex, value.to_bytes(size, "little"))
        except canopen.SdoAbortedError as abort:
            raise self._refused(f"0x{index:04X}:{subindex} cannot be set to 0x{value:X}", abort) from abort
        except canopen.SdoCommunicationError as error:
            raise silent(self._device, self._title, "no answer to SDO") from error

    def _text(self, index: int) -> str:
        """A text that a drive may lack."""
        try:
            return self._upload(index).decode(errors="replace").strip("\0 ")
        except DeviceRefused:
            return ""

    def _serial(self) -> str:
        try:
            return str(self._read(0x1018, 4))
        except DeviceRefused:
            return ""

    def _refused(self, what: str, abort: canopen.SdoAbortedError) -> DeviceRefused:
        cure = "does the drive support CiA 402 and free mapping of TPDO1? its manual says so"
        return DeviceRefused(self._device, f"{self._title}: object {what} ({abort})", cure)


def silent(device: str, title: str, what: str) -> DeviceLost:
    """The error of a node that sends nothing."""
    return DeviceLost(device, f"{title} is silent: {what}", "check its supply, its cable and its node number")


def state_of(statusword: int) -> str:
    """The state that a statusword shows: `operation enabled`."""
    return next((name for mask, bits, name in _STATES if statusword & mask == bits), f"0x{statusword:04X}")


@final
@dataclass(frozen=True, slots=True)
class DriveSample:
    """What one drive sent for one SYNC: position (its own increments), current (A)."""

    position: int
    current_a: float


@final
class DriveNode:
    """The drive of axis `axis` (from 1), node `number`; lives on the loop, only `objects` blocks.

    `current`: which object carries the current, see `CURRENTS`; `on_change` is called with every frame of it;
    `rated_a`: to be set before a sample; `unasked`: process data without our SYNC.
    """

    def __init__(
        self, device: str, axis: int, number: int, current: str, network: canopen.Network, clock: Clock
    ) -> None:
        self.number = number
        self.title = f"A{axis} (node {number})"
        self.rated_a = 0.0
        self.on_change: Callable[[], object] = lambda: None
        self.boot_ups = self.unasked = 0
        self._device, self._clock = device, clock
        self._current = CURRENTS[current]
        self._node = network.add_node(canopen.RemoteNode(number, canopen.ObjectDictionary()))
        self._node.nmt.add_heartbeat_callback(self._heard)
        self._node.emcy.add_callback(self._reported)
        network.subscribe(0x180 + number, self._received)
        self.objects = DriveObjects(device, self.title, number, self._node)
        self._frames: list[tuple[int, int, int]] = []
        self._ordered = self._asked = self._running = False
        self._trouble = ""
        self._heard_ns = clock.now_ns()

    def ordered(self) -> None:
        """It was told to be operational; from its first heartbeat that says so, any other state is a fault."""
        self._ordered, self._heard_ns = True, self._clock.now_ns()

    @property
    def operational(self) -> bool:
        """Whether a heartbeat has said so since the order."""
        return self._running

    @property
    def heartbeat_age_s(self) -> float:
        """Age of the last heartbeat, in the cell's time."""
        return (self._clock.now_ns() - self._heard_ns) * 1e-9

    @property
    def emergencies(self) -> list[str]:
        """The EMCY messages that it has not taken back."""
        return [_described(entry) for entry in self._node.emcy.active]

    @property
    def emergency_count(self) -> int:
        """All EMCY messages since the connection."""
        return len(self._node.emcy.log)

    def check(self) -> None:
        """Raises DeviceFault if it has restarted, stopped, or reports a fault, DeviceLost if it is silent."""
        if self._trouble:
            cure = "look for the cause (supply, another master on the bus), then connect again: its settings are lost"
            raise DeviceFault(self._device, self._trouble, cure)
        if emergencies := self.emergencies:
            cure = "look the code up in the drive's manual, remove the cause, and reset the drive's fault"
            raise DeviceFault(self._device, f"{self.title} reports a fault: {', '.join(emergencies)}", cure)
        if self.heartbeat_age_s > _OLDEST_HEARTBEAT_S:
            raise silent(self._device, self.title, f"no heartbeat for {self.heartbeat_age_s:.1f} s")

    def ask(self) -> None:
        """A SYNC is about to be sent: its frame is awaited."""
        self._asked = True
        self._frames.clear()

    @property
    def answered(self) -> bool:
        """Whether its frame for the last SYNC has come."""
        return bool(self._frames)

    def take(self) -> DriveSample:
        """The frame for the last SYNC; further ones are unasked for."""
        self._asked = False
        position, current, torque = self._frames[0]
        which, factor = self._current
        per_mille = current if which == 0x6078 else torque
        return DriveSample(position, per_mille * 1e-3 * self.rated_a * factor)

    @property
    def step_a(self) -> float:
        """One per mille, A."""
        return 1e-3 * self.rated_a * self._current[1]

    def _heard(self, state: int) -> None:
        self._heard_ns = self._clock.now_ns()
        self.boot_ups += state == _BOOT_UP
        if self._ordered and state == _OPERATIONAL:
            self._running = True
        elif self._running and not self._trouble:
            how = "has restarted" if state == _BOOT_UP else f"is {_NMT_STATES.get(state, state)}"
            self._trouble = f"{self.title} {how} while it was in use: it sends no process data"
        self.on_change()

    def _reported(self, entry: EmcyError) -> None:
        self.on_change()

    def _received(self, can_id: int, data: bytearray, timestamp: float) -> None:
        frame = _FRAME.unpack(data)
        if self._asked and not self._frames:
            self._frames.append(frame)
        elif self._running:
            self.unasked += 1
        self.on_change()


def _described(entry: EmcyError) -> str:
    words = entry.get_desc()
    return f"EMCY 0x{entry.code:04X}" + (f" ({words})" if words else "")
