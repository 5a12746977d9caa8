"""The probe's lines, one class for each type; fields as in docs/reference/probe-protocol.md."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

_CLOSED_BELOW_MV = 500
_OPEN_MV = range(1000, 2501)
"""States of the loop, as in docs/reference/probe-protocol.md."""


@final
@dataclass(frozen=True, slots=True)
class Boot:
    """`BOOT`: the probe has started; `cause` is `POWER`, `EXTERNAL`, `BROWNOUT` or `WATCHDOG`."""

    proto: int
    cause: str


@final
@dataclass(frozen=True, slots=True)
class Introduction:
    """`ID`: the probe's identity; its hardware count runs at `tick_hz`."""

    host_seq: int
    proto: int
    firmware: str
    name: str
    serial: str
    tick_hz: int
    cause: str


@final
@dataclass(frozen=True, slots=True)
class Heartbeat:
    """`HB`, every 50 ms: the state (`DISARMED`, `ARMED`, `TRIPPED`, `FAULT`) and the loop's voltage in mV."""

    state: str
    loop_mv: int
    host_ok: int

    @property
    def closed(self) -> bool:
        """Whether the loop is closed."""
        return self.loop_mv < _CLOSED_BELOW_MV

    @property
    def open(self) -> bool:
        """Whether the loop is open and whole. Neither closed nor open: broken, or an undefined voltage."""
        return self.loop_mv in _OPEN_MV


@final
@dataclass(frozen=True, slots=True)
class Edge:
    """`EDGE`: the first edge to *closed* while armed, at the hardware count `edge_tick`."""

    edge_tick: int


@final
@dataclass(frozen=True, slots=True)
class Confirmation:
    """`CONF`: whether the level held for 2 ms after that edge (1 or 0), and the number of further edges."""

    edge_tick: int
    confirmed: int
    bounces: int


@final
@dataclass(frozen=True, slots=True)
class Opened:
    """`OPEN`: the loop has been open for 20 ms after a contact."""

    edge_tick: int


@final
@dataclass(frozen=True, slots=True)
class Fault:
    """`FAULT`: `WIRE`, `STUCK`, `RANGE` or `HOST`."""

    code: str


@final
@dataclass(frozen=True, slots=True)
class Synced:
    """`SYNC`: the answer to a SYNC that was received by the hardware count `received_tick`."""

    host_seq: int
    received_tick: int


@final
@dataclass(frozen=True, slots=True)
class Reply:
    """`RE`: the answer to ARM and DISARM: `OK`, `CLOSED`, `WIRE`, `STATE` or `UNKNOWN`."""

    host_seq: int
    code: str


Answer = Introduction | Synced | Reply
"""The answer to the command `host_seq`."""

Message = Boot | Heartbeat | Edge | Confirmation | Opened | Fault | Answer
