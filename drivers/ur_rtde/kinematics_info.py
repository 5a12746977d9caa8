"""The kinematics that the controller computes with, as its primary interface states them: the arm's own calibration.

Source: Universal Robots, Client Interfaces (primary interface, robot state, kinematics info): a package is its length
(4 bytes, these included), its type (1 byte) and content; a robot state is a package of packages. All big-endian.
"""

from __future__ import annotations

import asyncio
import hashlib
import struct
from dataclasses import dataclass
from typing import final

from cellctl.clock import Clock, Wire
from cellctl.devices import ArmRows, DeviceLost, DeviceUnreachable

PORT = 30001
_ROBOT_STATE, _KINEMATICS = 16, 5
_LARGEST = 1 << 16
_HEADER = struct.Struct(">IB")
_CONTENT = struct.Struct(">6I24dI")
"""Check sums of the rows; θ, a, d, α of the six joints; whether the arm is calibrated."""

_OPEN_S, _ANSWER_S = 5.0, 5.0


def kinematics_of(state: bytes) -> bytes | None:
    """The kinematics in a robot state's content; None without. Raises ValueError for lengths that cannot be."""
    while state:
        if len(state) < _HEADER.size:
            raise ValueError("a robot state ends in the head of a package")
        length, kind = _HEADER.unpack_from(state)
        if not _HEADER.size <= length <= len(state):
            raise ValueError(f"a robot state has a package of {length} bytes in {len(state)}")
        if kind == _KINEMATICS:
            content = state[_HEADER.size : length]
            if len(content) != _CONTENT.size:
                raise ValueError(f"its kinematics have {len(content)} bytes, {_CONTENT.size} are known")
            return content
        state = state[length:]
    return None


@final
@dataclass(frozen=True, slots=True)
class Calibration:
    """The kinematics' content as it was sent."""

    content: bytes

    @property
    def digest(self) -> str:
        """SHA-256."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def rows(self) -> ArmRows:
        """The six joints' rows."""
        numbers = _CONTENT.unpack(self.content)[6:30]
        theta, a, d, alpha = (numbers[start : start + 6] for start in range(0, 24, 6))
        return ArmRows(theta, tuple(1000.0 * each for each in a), tuple(1000.0 * each for each in d), alpha)


async def read_calibration(device: str, host: str, clock: Clock, wire: Wire) -> Calibration:
    """The kinematics, from a connection of its own; its bytes count on the robot's `wire`.

    Raises DeviceUnreachable, DeviceLost.
    """
    cure = "Is the primary client interface released (Settings, Security, Services)?"
    writer = None
    try:
        with clock.standing():
            async with asyncio.timeout(_OPEN_S):
                reader, writer = await asyncio.open_connection(host, PORT)
        async with clock.timeout(_ANSWER_S):
            content = None
            while content is None:
                content = await _next_kinematics(reader, wire)
        return Calibration(content)
    except (ValueError, asyncio.IncompleteReadError) as error:
        raise DeviceLost(device, f"the primary interface at {host}:{PORT} states no kinematics: {error}") from error
    except (OSError, TimeoutError) as error:
        raise DeviceUnreachable(device, f"no kinematics from {host}:{PORT} ({error or 'no answer'})", cure) from error
    finally:
        if writer:
            await _leave(reader, writer, clock, wire)


async def _next_kinematics(reader: asyncio.StreamReader, wire: Wire) -> bytes | None:
    head = await reader.readexactly(_HEADER.size)
    length, kind = _HEADER.unpack(head)
    if not _HEADER.size <= length <= _LARGEST:
        raise ValueError(f"a package of {length} bytes is announced")
    content = await reader.readexactly(length - _HEADER.size)
    wire.read(length)
    return kinematics_of(content) if kind == _ROBOT_STATE else None


async def _leave(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, clock: Clock, wire: Wire) -> None:
    """Hang up; what the controller sent meanwhile is read: a simulated cell's time waits for it."""
    try:
        with clock.standing():
            async with asyncio.timeout(1.0):
                writer.write_eof()
                while data := await reader.read(_LARGEST):
                    wire.read(len(data))
    except (OSError, TimeoutError):  # it does not hang up, or broke before: then this end does
        pass
    finally:
        writer.close()
