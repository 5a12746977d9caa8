"""Opens and connects devices of a cell, with simulators if it is simulated; usable without a campaign."""

from __future__ import annotations

from collections.abc import AsyncIterator, Collection
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import Any, final

from cellctl.clock import Clock, WallClock
from cellctl.devices import Device, Identity, Listener
from cellctl.devices.cell import Cell, ClockMode
from cellctl.devices.registry import DriverRegistry
from cellctl.operations.device_locks import DeviceLocks
from cellctl.operations.simulated import SimulatedCell


@final
@dataclass(frozen=True, slots=True)
class Connected:
    """A connected device and its reported identity."""

    device: Any
    identity: Identity


def open_devices(
    cell: Cell,
    drivers: DriverRegistry,
    clock: Clock,
    simulated: SimulatedCell | None,
    names: Collection[str] | None = None,
) -> dict[str, Device]:
    """The cell's devices (those in `names`), not connected: at the file's addresses, or at the simulators'."""
    return {
        name: drivers.open(name, simulated.address(name) if simulated else address, cell.surroundings(name, clock))
        for name, address in cell.addresses.items()
        if names is None or name in names
    }


async def tell_targets(simulated: SimulatedCell | None, devices: dict[str, Device], clock: Clock) -> None:
    """Send a simulated cell the address of each listening driver; a real controller's configuration has it."""
    if simulated is None:
        return
    for name, device in devices.items():
        if isinstance(device, Listener):
            host, port = device.listening()
            with clock.standing():
                await simulated.tell({"op": "rsi_target", "device": name, "host": host, "port": port})


@asynccontextmanager
async def powered(
    cell: Cell, *, seed: int | None = None, clock: ClockMode | None = None, extra: tuple[str, ...] = ()
) -> AsyncIterator[tuple[SimulatedCell | None, Clock]]:
    """The simulators of a simulated cell inside this context (None: a real cell), and the cell's time.

    Raises InputError if the simulators refuse the cell file, DeviceUnreachable if they do not start.
    """
    async with AsyncExitStack() as stack:
        simulated = await SimulatedCell.start(cell, seed, clock, extra) if cell.simulated else None
        if simulated:
            stack.callback(simulated.stop)
        time = await simulated.clock() if simulated else WallClock()
        stack.push_async_callback(time.aclose)
        yield simulated, time


@asynccontextmanager
async def connected(
    cell: Cell,
    drivers: DriverRegistry,
    names: Collection[str],
    *,
    seed: int | None = None,
    clock: ClockMode | None = None,
    extra: tuple[str, ...] = (),
) -> AsyncIterator[dict[str, Connected]]:
    """The devices `names` of a cell, connected inside this context, closed at its end.

    seed, clock, extra: for the simulators of a simulated cell, which run as long. Raises InputError, DeviceError;
    DeviceBusy, before anything connects, if another process has one of them.
    """
    async with AsyncExitStack() as stack:
        locks = stack.enter_context(DeviceLocks.held(cell, drivers, names=names))
        simulated, time = await stack.enter_async_context(powered(cell, seed=seed, clock=clock, extra=extra))
        devices = open_devices(cell, drivers, time, simulated, names)
        found = {}
        for name, device in devices.items():
            stack.push_async_callback(device.close)
            found[name] = Connected(device, await device.connect())
            locks.meet(found[name].identity)
        await tell_targets(simulated, devices, time)
        yield found
