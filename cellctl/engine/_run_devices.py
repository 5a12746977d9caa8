"""The devices of a run: their health for the journal, and the clean-up that stops and closes each of them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from functools import partial
from typing import final

from cellctl.clock import Clock
from cellctl.devices import CellIO, Device, DeviceError, Health
from cellctl.engine._recorder import Recorder
from cellctl.journal import DeviceHealth


@final
class DeviceReports:
    """Records what devices report of themselves.

    Inputs are those of the driver's own poll: reading them sends nothing, and takes no time of the cell.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._inputs: dict[CellIO, Mapping[str, bool]] = {}

    async def at_start(self, devices: Iterable[Device]) -> None:
        """Record the health of each connected device. Raises DeviceError."""
        for device in devices:
            health = await device.health()
            self._recorder.said("", f"{device.name}: {health.text}")
            if isinstance(device, CellIO):
                self._inputs[device] = await device.inputs()
            self._record(device, health)

    async def look_for_losses(self, devices: Iterable[Device]) -> None:
        """Ask each device how it is: one that was lost after its last step is not passed over. Raises DeviceError."""
        for device in devices:
            await device.health()

    async def between_steps(self) -> None:
        """Record the health of each CellIO whose inputs have changed, or can no longer be read."""
        for device, before in self._inputs.items():
            try:
                now, health = await device.inputs(), await device.health()
            except DeviceError as error:
                now, health = {}, Health(False, error.what)
            if now != before:
                self._inputs[device] = now
                self._record(device, health)

    async def at_end(self, device: Device) -> None:
        """Record what a device of a run that failed reports last: its emergency stop, its fault, or nothing."""
        try:
            health = await device.health()
            if isinstance(device, CellIO):
                self._inputs[device] = await device.inputs()
        except DeviceError as error:
            health = Health(False, error.what)
            if isinstance(device, CellIO):
                self._inputs[device] = {}
        self._record(device, health)

    def _record(self, device: Device, health: Health) -> None:
        inputs = self._inputs.get(device, {}) if isinstance(device, CellIO) else {}
        latency_ms = health.figures.get("latency_ms")
        self._recorder.append(DeviceHealth(device.name, health.ok, health.text, latency_ms, health.mode, inputs))


_STOP_SECONDS = 10.0
"""Time limit for one device to reach its safe state, s, in the cell's time."""

_LOOK_SECONDS = 2.0
"""Time limit for a last look at a device before it is closed, s, in the cell's time."""

_CLOSE_WALL_SECONDS = 30.0
"""Time limit for closing a device, s. Wall time: ports and processes of this host use it."""

CLEANUP_SECONDS = 30.0
"""Time limit, s, of a clean-up step that sets none."""


async def stop_and_close(
    devices: Sequence[Device],
    clock: Clock,
    stopped: set[str],
    look: Callable[[Device], Awaitable[None]] | None = None,
) -> list[str]:
    """Stop and close each device; returns the failures as text. Adds devices that confirmed the stop to `stopped`.

    One after the other, in the order of the cell file. What was in motion in the step was stopped before, by the step's
    own end or cancellation: this is the confirmation.

    `look`: is awaited with each device that is stopped and still connected; what it does not achieve is no failure.
    """
    troubles: list[str] = []
    for device in devices:
        failed = await stopped_safely(device, clock)
        troubles += failed
        if not failed:
            stopped.add(device.name)
        if look:
            await _tried(partial(look, device), clock.timeout(_LOOK_SECONDS), "")
        free = f"{device.name} could not be let go of"
        troubles += await _tried(device.close, asyncio.timeout(_CLOSE_WALL_SECONDS), free)
    return troubles


async def stopped_safely(device: Device, clock: Clock) -> list[str]:
    """Bring a device to its safe state; returns the failure as text, if it does not confirm that."""
    safe = f"{device.name} could not be brought to its safe state"
    return await _tried(device.stop, clock.timeout(_STOP_SECONDS), safe)


async def _tried(
    action: Callable[[], Awaitable[None]], bound: AbstractAsyncContextManager[object], otherwise: str
) -> list[str]:
    """Do one clean-up action within `bound`; returns the failure as text that begins with `otherwise`."""
    try:
        async with bound:
            await action()
    except Exception as failure:
        return [f"{otherwise}: {str(failure) or type(failure).__name__}"]
    return []
