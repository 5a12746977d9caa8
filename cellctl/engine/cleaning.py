"""The clean-up: runs every clean-up step, stops and closes every device, even after failures."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from functools import partial

from cellctl.clock import Clock
from cellctl.devices import Device

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
