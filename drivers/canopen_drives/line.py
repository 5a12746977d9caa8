"""The CAN bus on the engine's loop: frames in and out, counted, and canopen's network on top of them."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from typing import Any, final

import can
import canopen

from cellctl.clock import Clock, Wire
from cellctl.devices import DeviceLost, DeviceUnreachable
from drivers.canopen_drives.place import CanPlace

_CURES = {
    "socketcan": "is the interface up? `ip -details link show {channel}`; to set it up: "
    "`ip link set {channel} up type can bitrate 1000000`",
    "udp_multicast": "does a simulated cell run at that port, and is there a route to {channel}?",
    "virtual": "the drives have to be in this process",
}
_POLL_S = 0.05
"""Wall time within which the thread of a bus without a file descriptor ends."""
_ERRORS_IN_A_ROW = 100
_FROM_DRIVES = {0x080, 0x180, 0x280, 0x380, 0x480, 0x580, 0x700}
"""Function codes of frames that nodes send: EMCY, TPDO 1 … 4, SDO answer, heartbeat."""


@final
class CanLine:
    """An open bus and its network, until `close`.

    canopen's blocking SDO calls run in a thread; everything that is received goes through the loop. `lost`: why the
    bus gives nothing more, empty without. `error_frames`, `unreadable`: counts. `on_lost` is called on the loop.
    """

    def __init__(self, device: str, place: CanPlace, clock: Clock) -> None:
        self.lost = ""
        self.error_frames = self.unreadable = 0
        self.on_lost: Callable[[], object] = lambda: None
        self._device, self._clock = device, clock
        self._errors_in_a_row = 0
        self._loop = asyncio.get_running_loop()
        self._notifier: can.Notifier | None = None
        try:
            self._bus = can.Bus(**place.bus_settings())
        except (can.CanError, OSError, ValueError) as error:
            cure = _CURES[place.interface].format(channel=place.channel)
            raise DeviceUnreachable(device, f"the CAN bus {place} cannot be opened: {error}", cure) from error
        self._wire = clock.wire(device)
        self.network = _CountedNetwork(self._bus, self._wire)
        self._fd = _descriptor(self._bus)
        if self._fd is None:
            self._notifier = can.Notifier(self._bus, [self._arrived], _POLL_S, self._loop)
        else:
            self._loop.add_reader(self._fd, self._readable)

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame. Raises DeviceLost."""
        self.check()
        try:
            self.network.send_message(can_id, data)
        except (can.CanError, OSError) as error:
            cure = "is any drive on the bus, has it two terminators, and is the bitrate right?"
            raise DeviceLost(self._device, f"a frame cannot be sent: {error}", cure) from error

    def check(self) -> None:
        """Raises DeviceLost if the bus is lost."""
        if self.lost:
            cure = "check the CAN adapter and its cable, then connect again"
            raise DeviceLost(self._device, f"the CAN bus is gone: {self.lost}", cure)

    def close(self) -> None:
        """Leave the bus."""
        self._stop_reading()
        self.network.bus = None
        self._bus.shutdown()
        self._wire.close()

    def _readable(self) -> None:
        try:
            message = self._bus.recv(0)
        except (can.CanError, OSError) as error:
            self._count_error(error)
            return
        self._errors_in_a_row = 0
        if message is not None:
            self._arrived(message)

    def _count_error(self, error: Exception) -> None:
        """One datagram that is no frame is passed over; an adapter that is gone gives errors without end."""
        self.unreadable += 1
        self._errors_in_a_row += 1
        if self._errors_in_a_row >= _ERRORS_IN_A_ROW:
            self.lost = str(error)
            self._stop_reading()
            self._wire.close()
            self.on_lost()

    def _arrived(self, message: can.Message) -> None:
        if message.is_error_frame:
            self.error_frames += 1
        elif not (message.is_remote_frame or message.is_extended_id):
            self._take(message.arbitration_id, message.data)

    def _take(self, can_id: int, data: bytearray) -> None:
        try:
            self.network.notify(can_id, data, self._clock.now())
        except (struct.error, ValueError, IndexError):  # shorter than its service needs
            self.unreadable += 1
        if can_id & 0x780 in _FROM_DRIVES and can_id & 0x7F:
            self._wire.read(1)

    def _stop_reading(self) -> None:
        if self._notifier is not None:
            self._notifier.stop()
        if self._fd is not None:
            self._loop.remove_reader(self._fd)
        self._notifier = self._fd = None


@final
class _CountedNetwork(canopen.Network):
    """canopen's network on a bus that it does not read itself; frames sent are counted on `wire`."""

    def __init__(self, bus: can.BusABC, wire: Wire) -> None:
        super().__init__(bus)
        self._wire = wire

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        """Send a frame, from any thread."""
        super().send_message(can_id, data, remote)
        self._wire.wrote(1)


def _descriptor(bus: can.BusABC) -> int | None:
    """Its file descriptor; None if it has none (`virtual`)."""
    try:
        return bus.fileno()
    except NotImplementedError:
        return None
