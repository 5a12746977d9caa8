"""Examines the devices of a cell: connects to each, whatever the others do, and reads identity, latency and health."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Any, final

from cellctl.clock import Clock
from cellctl.devices import CellIO, Device, DeviceError, DeviceUnreachable, Health, Identity
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.cell_devices import DeviceLocks, open_devices, powered, require_cells, tell_targets
from cellctl.operations.worker import Tell

_ANSWER_S = 30.0
"""Longest wait for one device, in the cell's time."""

_LOOKS, _EVERY_S = 5, 0.1
"""Health is read as often; the latency is the median."""

_CURE = "remove the cause, then run doctor again"


@final
@dataclass(frozen=True)
class ClockFit:
    """A device's clock against the cell's, from its driver: ms, 1e-6, ms (1 σ of one mapped instant)."""

    offset_ms: float
    drift_ppm: float
    sigma_ms: float


@final
@dataclass(frozen=True)
class Examined:
    """What was found of one device. `identity`: None if it could not be read. `what`, `cure`: if it is not healthy.

    `latency_ms`: from a request to its answer in the cell's time, None if its driver does not report it. `clock`: None
    if the driver maps no clock, or has not mapped it yet. `inputs`: of the cell's PLC, by name.
    """

    name: str
    address: str
    identity: Identity | None = None
    health: Health | None = None
    latency_ms: float | None = None
    clock: ClockFit | None = None
    inputs: Mapping[str, bool] = field(default_factory=dict)
    what: str = ""
    cure: str = ""

    @property
    def healthy(self) -> bool:
        """Whether it answered, and reports that it is in order."""
        return self.health is not None and self.health.ok and not self.what

    def dump(self) -> dict[str, Any]:
        """As JSON has it."""
        identity, clock = self.identity, self.clock
        return {
            "name": self.name,
            "address": self.address,
            "healthy": self.healthy,
            "identity": identity
            and {
                "serial": identity.serial,
                "model": identity.model,
                "firmware": identity.firmware,
                "simulated": identity.simulated,
            },
            "latency_ms": self.latency_ms,
            "clock": clock and vars(clock),
            "health": self.health.text if self.health else None,
            "figures": self.health.figures if self.health else {},
            "mode": self.health.mode if self.health else "",
            "inputs": dict(self.inputs),
            "what": self.what,
            "cure": self.cure,
        }


@final
@dataclass(frozen=True)
class Examination:
    """A cell's devices, examined one by one."""

    cell: str
    simulated: bool
    devices: tuple[Examined, ...]

    @property
    def healthy(self) -> bool:
        """Whether every device answered, and reports that it is in order."""
        return all(one.healthy for one in self.devices)

    def to_json(self) -> dict[str, Any]:
        """As JSON has it."""
        devices = [one.dump() for one in self.devices]
        return {"cell": self.cell, "simulated": self.simulated, "healthy": self.healthy, "devices": devices}


async def examination(cell: Cell, drivers: DriverRegistry, seed: int | None = None) -> Examination:
    """Every device of the cell, examined (see `examine`)."""
    require_cells()
    return Examination(cell.name, cell.simulated, await examine(cell, drivers, seed))


def examine_requested(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """The operation of the worker: the devices of the `cell` file, examined."""
    drivers = DriverRegistry()
    return asyncio.run(examination(Cell.load(Path(request["cell"]), drivers), drivers)).to_json()


async def examine(cell: Cell, drivers: DriverRegistry, seed: int | None = None) -> tuple[Examined, ...]:
    """All devices of a cell, in the order of its file; nothing moves. The simulators of a simulated cell run meanwhile.

    Raises InputError if the simulators refuse the cell file, DeviceUnreachable if they do not start,
    DeviceBusy, before anything connects, if another process has a device of the cell.
    """
    with DeviceLocks.held(cell, drivers) as locks:
        return await _examined(cell, drivers, seed, locks)


async def _examined(cell: Cell, drivers: DriverRegistry, seed: int | None, locks: DeviceLocks) -> tuple[Examined, ...]:
    async with powered(cell, seed=seed) as (simulated, clock):
        devices = open_devices(cell, drivers, clock, simulated)
        try:
            met = await asyncio.gather(*(_meet(device, cell, clock, locks) for device in devices.values()))
            answering = {one.name: devices[one.name] for one in met if one.identity}
            await tell_targets(simulated, answering, clock)
            return tuple([await _look_at(one, devices[one.name], clock) for one in met])
        finally:
            for device in devices.values():
                await device.close()


async def _meet(device: Device, cell: Cell, clock: Clock, locks: DeviceLocks) -> Examined:
    one = Examined(device.name, str(cell.addresses[device.name]))
    try:
        async with clock.timeout(_ANSWER_S):
            identity = await device.connect()
        locks.meet(identity)
        return replace(one, identity=identity)
    except Exception as error:  # a driver's own mistake too: the other devices are examined all the same
        return _failed(one, error)


async def _look_at(one: Examined, device: Device, clock: Clock) -> Examined:
    if one.identity is None:
        return one
    try:
        async with clock.timeout(_ANSWER_S):
            looks = []
            for _ in range(_LOOKS):
                looks.append(await device.health())
                await clock.sleep(_EVERY_S)
            inputs = await device.inputs() if isinstance(device, CellIO) else {}
    except Exception as error:
        return _failed(one, error)
    health = looks[-1]
    latencies = [look.figures["latency_ms"] for look in looks if "latency_ms" in look.figures]
    return replace(
        one,
        health=health,
        latency_ms=median(latencies) if latencies else None,
        clock=_clock_fit(health.figures),
        inputs=inputs,
        what="" if health.ok else health.text,
        cure="" if health.ok else _CURE,
    )


def _clock_fit(figures: Mapping[str, float]) -> ClockFit | None:
    names = ("clock_offset_ms", "clock_drift_ppm", "clock_sigma_ms")
    return ClockFit(*(figures[name] for name in names)) if figures.keys() >= set(names) else None


def _failed(one: Examined, error: Exception) -> Examined:
    match error:
        case DeviceError():
            return replace(one, what=error.what, cure=error.cure or _CURE)
        case TimeoutError():
            late = DeviceUnreachable(one.name, f"did not answer within {_ANSWER_S:g} s", "is it switched on?")
            return replace(one, what=late.what, cure=late.cure)
    return replace(one, what=f"its driver failed: {type(error).__name__}: {error}", cure="report it to its author")
