"""Examines the devices of a cell: connects to each, whatever the others do, and reads identity, latency and health."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import Annotated, Any, final

from pydantic import Field

from cellctl.clock import Clock
from cellctl.devices import CellIO, Device, DeviceError, DeviceUnreachable
from cellctl.devices.cell import Cell
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.cell_devices import DeviceLocks, open_devices, powered, require_cells, tell_targets
from cellctl.operations.results import as_json
from cellctl.operations.worker import Tell
from cellctl.records import Json

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
class ReportedIdentity:
    """What a device reported of itself, see `Identity`."""

    serial: str
    model: str
    firmware: str
    simulated: bool


@final
@dataclass(frozen=True)
class Examined:
    """What was found of one device. `healthy`: it answered, and reports that it is in order; else `what` and `cure`.

    `identity`: None if it could not be read. `latency_ms`: from a request to its answer in the cell's time, None if its
    driver does not report it. `clock`: None if the driver maps no clock, or has not mapped it yet. `health`, `figures`,
    `mode`: as of `Health`; None and empty if not read. `inputs`: of the cell's PLC, by name.
    """

    name: str
    address: str
    healthy: bool = False
    identity: ReportedIdentity | None = None
    latency_ms: float | None = None
    clock: ClockFit | None = None
    health: str | None = None
    figures: Mapping[str, Json] = field(default_factory=dict)
    mode: str = ""
    inputs: Mapping[str, bool] = field(default_factory=dict)
    what: str = ""
    cure: str = ""


@final
@dataclass(frozen=True)
class Examination:
    """A cell's devices, examined one by one; healthy: each of them is. at: UTC, of one that is kept beside the runs."""

    cell: str
    simulated: bool
    healthy: bool
    devices: tuple[Examined, ...]
    at: Annotated[str, Field(exclude_if=lambda at: not at)] = ""


async def examination(cell: Cell, drivers: DriverRegistry, seed: int | None = None) -> Examination:
    """Every device of the cell, examined (see `examine`)."""
    require_cells()
    devices = await examine(cell, drivers, seed)
    return Examination(cell.name, cell.simulated, all(one.healthy for one in devices), devices)


def examine_requested(request: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """The operation of the worker: the devices of the `cell` file, examined."""
    drivers = DriverRegistry()
    return as_json(asyncio.run(examination(Cell.load(Path(request["cell"]), drivers), drivers)))


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
        reported = ReportedIdentity(identity.serial, identity.model, identity.firmware, identity.simulated)
        return replace(one, identity=reported)
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
        healthy=health.ok,
        health=health.text,
        figures=health.figures,
        mode=health.mode,
        latency_ms=median(latencies) if latencies else None,
        clock=_clock_fit(health.figures),
        inputs=dict(inputs),
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
