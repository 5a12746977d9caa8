"""The state machine of a drive (CiA 402, power drive system), on the drive's side: controlword in, statusword out."""

from __future__ import annotations

from enum import IntEnum
from typing import final


class State(IntEnum):
    """State, by its bits of the statusword."""

    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT = 0x08


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
