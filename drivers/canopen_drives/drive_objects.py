"""A drive's objects by SDO: what is read and set when it is connected. Every call blocks: it belongs in a thread."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import canopen

from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused

HEARTBEAT_MS = 1000
_ANSWER_S = 5.0
"""Wall time after which a node that does not answer is taken for dead; a bound only: it has answered before."""

_DRIVE_PROFILE = 402
_MAPPING = (0x6064_0020, 0x6078_0010, 0x6077_0010)
"""TPDO1: position, current, torque."""
_NOT_VALID = 0x8000_0000
_EACH_SYNC = 1


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
