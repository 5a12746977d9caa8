"""The drives as a source of motor currents: connect, sample all axes with one SYNC, health."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from math import hypot, sqrt
from statistics import fmean, stdev
from typing import TypeVar, final

from cellctl.clock import Clock
from cellctl.devices import DeviceFault, DeviceLost, DeviceRefused, DeviceUnreachable, Health, Identity, MotorCurrents
from drivers.canopen_drives.drive import FAULT, OPERATION_ENABLED, DriveData, DriveNode, DriveSample, silent, state_of
from drivers.canopen_drives.line import CanLine
from drivers.canopen_drives.place import CanPlace

_FOUND_S = 1.0
_STARTED_S = 2.5
_ANSWER_S = 0.1
"""Time within which every drive answers a SYNC: more than a hundred times the frames' time on the bus."""
_SYNC_EVERY_S = 0.01

_SYNC, _NMT, _SDO = 0x080, 0x000, 0x600
_PRE_OPERATIONAL, _START = 0x80, 0x01
_READ_DEVICE_TYPE = bytes([0x40, 0x00, 0x10, 0, 0, 0, 0, 0])

Result = TypeVar("Result")


@final
class CanopenDrives:
    """A CurrentSource on CANopen drives (CiA 402). It reads; it never commands a motor.

    Currents are those of the drives, without scale and offset of the cell file.
    """

    def __init__(self, name: str, place: CanPlace, clock: Clock) -> None:
        self.name = name
        self._place, self._clock = place, clock
        self._line: CanLine | None = None
        self._nodes: list[DriveNode] = []
        self._changed = asyncio.Event()
        self._sampling = asyncio.Lock()

    async def connect(self) -> Identity:
        """Open the bus, set the drives up in pre-operational, start them, and wait for their heartbeats.

        Raises DeviceUnreachable (no bus, a node is missing), DeviceRefused (no CiA 402 drive), DeviceFault (rated
        values of 0, EMCY).
        """
        await self.close()
        try:
            return await self._connect()
        except DeviceLost as error:
            await self.close()
            raise DeviceUnreachable(self.name, error.what, error.cure) from error
        except BaseException:
            await self.close()
            raise

    async def health(self) -> Health:
        """State of every drive and EMCY messages, counts since `connect`. Raises DeviceLost."""
        line = self._connected()
        states = await self._states()
        text = ", ".join(f"{node.title} {state}" for node, state in zip(self._nodes, states, strict=True))
        try:
            for node in self._nodes:
                node.check()
        except DeviceFault as fault:
            return Health(False, f"{fault.what}; {text}", self._figures(line))
        return Health(FAULT not in states, text, self._figures(line))

    async def stop(self) -> None:
        """Nothing: without SYNC the drives send nothing, and they are never commanded."""

    async def close(self) -> None:
        """Leave the bus. The drives stay operational."""
        line, self._line, self._nodes = self._line, None, []
        if line:
            line.close()

    async def currents(self, samples: int) -> MotorCurrents:
        """Mean of `samples` (at least 1) readings of all axes, 10 ms apart; see CurrentSource.

        Raises DeviceRefused if a drive is not in operation: its brake is closed, so its current says nothing.
        """
        if samples < 1:
            raise ValueError(f"{samples} samples of motor currents")
        async with self._sampling:
            self._connected()
            for node in self._nodes:
                node.unasked = 0
            first_ns = self._clock.now_ns()
            rows = [await self.sample()]
            while len(rows) < samples:
                await self._clock.sleep(_SYNC_EVERY_S)
                rows.append(await self.sample())
            middle_ns = (first_ns + self._clock.now_ns()) // 2
            await self._refuse_closed_brakes()
        columns = [[sample.current_a for sample in column] for column in zip(*rows, strict=True)]
        sigmas = tuple(_sigma(column, node.step_a) for column, node in zip(columns, self._nodes, strict=True))
        return MotorCurrents(tuple(map(fmean, columns)), sigmas, samples, middle_ns)

    async def sample(self) -> tuple[DriveSample, ...]:
        """Send a SYNC; every axis, measured at that moment. Raises DeviceFault, DeviceLost naming the drive."""
        line = self._connected()
        for node in self._nodes:
            node.check()
            if node.unasked:
                what = f"{node.title} sends process data without our SYNC"
                raise DeviceFault(self.name, what, "let no other master on this bus send SYNC or set up TPDO1")
            node.ask()
        line.send(_SYNC, b"")
        missing = await self._until(lambda node: node.answered, _ANSWER_S)
        if missing:
            raise silent(self.name, missing[0].title, f"no answer to SYNC within {_ANSWER_S * 1e3:g} ms")
        return tuple(node.take() for node in self._nodes)

    async def _connect(self) -> Identity:
        await self._clock.sleep(0.001)  # a simulated cell tells its count of frames of an earlier connection first
        line = self._line = CanLine(self.name, self._place, self._clock)
        line.on_lost = self._changed.set
        for number in self._place.nodes:
            line.send(_NMT, bytes([_PRE_OPERATIONAL, number]))
        await self._find(line)
        self._nodes = [
            DriveNode(self.name, axis, number, self._place.current, line.network, self._clock)
            for axis, number in enumerate(self._place.nodes, 1)
        ]
        for node in self._nodes:
            node.on_change = self._changed.set
        found = await self._in_thread(lambda: [node.objects.set_up() for node in self._nodes])
        for node, data in zip(self._nodes, found, strict=True):
            node.rated_a = data.rated_a
        await self._start(line)
        return self._identity(found)

    async def _find(self, line: CanLine) -> None:
        """Ask every node for its device type, and wait in the cell's time. Raises DeviceUnreachable."""
        scanner, numbers = line.network.scanner, self._place.nodes
        for number in numbers:
            line.network.subscribe(0x580 + number, lambda can_id, data, timestamp: self._changed.set())
            line.send(_SDO + number, _READ_DEVICE_TYPE)
        missing = await self._wait(lambda: [number for number in numbers if number not in scanner.nodes], _FOUND_S)
        if missing:
            which = f"node {missing[0]}" if len(missing) == 1 else f"nodes {', '.join(map(str, missing))}"
            what = f"{which} of {len(numbers)} on {self._place} did not answer within {_FOUND_S:g} s"
            cure = "check supply, bitrate, terminators, and the node numbers in the address"
            raise DeviceUnreachable(self.name, what, cure)

    async def _start(self, line: CanLine) -> None:
        for node in self._nodes:
            line.send(_NMT, bytes([_START, node.number]))
            node.ordered()
        if missing := await self._until(lambda node: node.operational, _STARTED_S):
            raise silent(self.name, missing[0].title, "it has not reported that it is operational")

    async def _states(self) -> list[str]:
        nodes = self._nodes
        return await self._in_thread(lambda: [state_of(node.objects.statusword()) for node in nodes])

    async def _refuse_closed_brakes(self) -> None:
        for node, state in zip(self._nodes, await self._states(), strict=True):
            node.check()
            if state == FAULT:
                code = await self._in_thread(node.objects.error_code)
                cure = "look the code up in the drive's manual, remove the cause, and reset the drive's fault"
                raise DeviceFault(self.name, f"{node.title} is at fault, error code 0x{code:04X}", cure)
            if state != OPERATION_ENABLED:
                what = f"{node.title} is in '{state}': its brake is closed, and its current says nothing"
                raise DeviceRefused(self.name, what, "take the currents right after a motion, before the brakes close")

    async def _until(self, done: Callable[[DriveNode], bool], seconds: float) -> list[DriveNode]:
        """The nodes for which `done` is still false after `seconds`. Raises DeviceFault, DeviceLost."""

        def missing() -> list[DriveNode]:
            for node in self._nodes:
                node.check()
            return [node for node in self._nodes if not done(node)]

        return await self._wait(missing, seconds)

    async def _wait(self, missing: Callable[[], list[Result]], seconds: float) -> list[Result]:
        """What is missing after `seconds` of the cell's time; looked at with every change. Raises DeviceLost."""
        try:
            async with self._clock.timeout(seconds):
                while missing():
                    self._connected()
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            return missing()
        return []

    async def _in_thread(self, work: Callable[[], Result]) -> Result:
        """Blocking SDO transfers; the answers come through this loop, and a simulated cell's time stops meanwhile."""
        with self._clock.standing():
            return await asyncio.to_thread(work)

    def _connected(self) -> CanLine:
        if self._line is None:
            raise DeviceLost(self.name, "is not connected", "connect it first")
        self._line.check()
        return self._line

    def _identity(self, found: Sequence[DriveData]) -> Identity:
        names = list(dict.fromkeys(one.name for one in found))
        firmware = list(dict.fromkeys(one.firmware for one in found))
        simulated = any(name.upper().startswith("SIM") for name in names)
        serial = ("SIM-" if simulated else "") + ",".join(one.serial for one in found)
        return Identity(self.name, serial, f"{len(found)} × {' / '.join(names)}", " / ".join(firmware), simulated)

    def _figures(self, line: CanLine) -> dict[str, float]:
        return {
            "heartbeat_age_ms": max(node.heartbeat_age_s for node in self._nodes) * 1e3,
            "emergencies": sum(node.emergency_count for node in self._nodes),
            "restarts": sum(node.boot_ups for node in self._nodes),
            "error_frames": line.error_frames,
            "unreadable": line.unreadable,
        }


def _sigma(values: Sequence[float], step: float) -> float:
    """1 σ of one sample: its scatter and its resolution."""
    return hypot(stdev(values) if len(values) > 1 else 0.0, step / sqrt(12.0))
