"""A transmit PDO: its parameters as a master writes them by SDO, and the frame that they make."""

from __future__ import annotations

from typing import final

from canopen import LocalNode, SdoAbortedError

from sims.drives.objects import INVALID, MAPPABLE

NOT_NOW = 0x0800_0022
"""Abort codes of CiA 301: not in the present state of the device; not mappable; longer than 8 bytes; value range."""
NOT_MAPPABLE, TOO_LONG, OUT_OF_RANGE = 0x0604_0041, 0x0604_0042, 0x0609_0030
_PRE_OPERATIONAL = "PRE-OPERATIONAL"
_LONGEST_BITS = 64


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
