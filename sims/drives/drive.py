"""One drive: a CANopen node with the state machine of CiA 402, and what it measures on its motor."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import canopen

from sims.drives.bus import KernelNetwork
from sims.drives.objects import (
    CONTROLWORD,
    CURRENT,
    ERROR_CODE,
    POSITION,
    STATUSWORD,
    TORQUE,
    TRANSMIT_PDOS,
    objects_of,
)
from sims.drives.state_machine import ENABLE_OPERATION, SHUTDOWN, SWITCH_ON, State, StateMachine
from sims.drives.transmit_pdo import TransmitPdo

NM_PER_A = 0.4
"""Torque constant of the motor, from which the rated torque follows."""
INCREMENTS_PER_DEG = 10_000
_GENERIC_ERROR = 0x01
_OPERATIONAL = "OPERATIONAL"


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
