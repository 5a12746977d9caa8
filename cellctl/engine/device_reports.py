"""Health of the devices for the journal: at the start and after a failure; inputs of the cell between two steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import final

from cellctl.devices import CellIO, Device, DeviceError, Health
from cellctl.engine.recorder import Recorder
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
