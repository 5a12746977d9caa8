"""The CAN bus of the simulated drives: frames over UDP multicast on this computer, sent and received by the kernel."""

from __future__ import annotations

import socket
from collections.abc import Callable
from functools import partial
from typing import Any, final

import can
import canopen

from sims.kernel import Kernel
from sims.simulator import CannotStart
from sims.wires import Wire

GROUP = "239.74.163.2"
MS = 1_000_000
_FROM_DRIVES = {0x080, 0x180, 0x280, 0x380, 0x480, 0x580, 0x700}
"""Function codes of EMCY, TPDO 1 … 4, SDO answer and heartbeat. With node 0 the first is SYNC, which a master sends."""


def is_from_drive(can_id: int) -> bool:
    """Whether a drive sends frames of this COB-ID."""
    return can_id & 0x780 in _FROM_DRIVES and can_id & 0x7F != 0


def open_bus() -> tuple[can.BusABC, int]:
    """A bus of its own on a free port, and the port. Raises CannotStart."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("", 0))
        port = int(free.getsockname()[1])
    try:
        return can.Bus(interface="udp_multicast", channel=GROUP, port=port, hop_limit=0, fd=False), port
    except (can.CanError, OSError) as error:
        raise CannotStart(f"no CAN bus over UDP multicast here: {error}; is there a route to {GROUP}?") from None


@final
class KernelNetwork(canopen.Network):
    """A CANopen network whose frames and periodic frames are the kernel's events; frames are counted on `wire`.

    `first`: the first axis' node; `is_silent`: node → whether its frames are lost. `on_host_frame` is called with
    COB-ID and data of each frame from a master, after the nodes took it.
    """

    def __init__(
        self, bus: can.BusABC, kernel: Kernel, wire: Wire, first: int, is_silent: Callable[[int], bool]
    ) -> None:
        super().__init__(bus)
        self.on_host_frame: Callable[[int, bytes], object] = lambda can_id, data: None
        self._kernel = kernel
        self._wire = wire
        self._first = first
        self._is_silent = is_silent
        self._periodic: dict[int, list[PeriodicFrame]] = {}
        kernel.watch(bus.fileno(), self._read)

    def close(self) -> None:
        """Leave the bus."""
        if self.bus is not None:
            self._kernel.unwatch(self.bus.fileno())
            self.bus.shutdown()
        self.bus = None

    def send_message(self, can_id: int, data: Any, remote: bool = False) -> None:
        """Send a drive's frame, unless it is silent."""
        if self.bus is not None and not self._is_silent(can_id & 0x7F):
            super().send_message(can_id, data, remote)
            self._wire.wrote(1)

    def send_periodic(self, can_id: int, data: Any, period: float, remote: bool = False) -> PeriodicFrame:  # type: ignore[override]
        """Send a frame every `period` seconds of the cell's time, from now on."""
        frame = PeriodicFrame(can_id, data, round(period * 1e9))
        self._send_periodically([frame])
        return frame

    def _send_periodically(self, frames: list[PeriodicFrame]) -> None:
        """Send frames, and again after their period; frames that are due together are one event."""
        for frame in frames:
            if frame.stopped:
                continue
            self.send_message(frame.can_id, frame.data)
            due = self._kernel.now + frame.period_ns
            if due not in self._periodic:
                self._periodic[due] = []
                self._kernel.at(due, partial(self._send_due, due))
            self._periodic[due].append(frame)

    def _send_due(self, due_ns: int) -> None:
        self._send_periodically(self._periodic.pop(due_ns))

    def _read(self) -> None:
        """All frames that wait; those of the drives come back to this socket and are passed over."""
        while self.bus is not None:
            try:
                message = self.bus.recv(0)
            except can.CanError:  # a datagram that is no frame; the kernel calls again for those behind it
                return
            if message is None:
                return
            if not (message.is_extended_id or is_from_drive(message.arbitration_id)):
                self._take(message.arbitration_id, bytes(message.data), message.timestamp)

    def _take(self, can_id: int, data: bytes, timestamp: float) -> None:
        """A master's frame. It begins a session with the first node in pre-operational."""
        if can_id == 0 and data in (b"\x80\x00", bytes([0x80, self._first])):
            self._wire.opened()
        self.notify(can_id, bytearray(data), timestamp)
        self.on_host_frame(can_id, data)
        self._wire.read(1)


@final
class PeriodicFrame:
    """A frame that is sent again and again until `stop`; as canopen's periodic tasks."""

    def __init__(self, can_id: int, data: Any, period_ns: int) -> None:
        self.can_id, self.data, self.period_ns = can_id, data, period_ns
        self.stopped = False

    def update(self, data: Any) -> None:
        """The data from now on."""
        self.data = data

    def stop(self) -> None:
        """Send it no more."""
        self.stopped = True
