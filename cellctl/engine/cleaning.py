"""The clean-up: every clean-up step, and every device stopped and closed, whatever fails in it."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager

from cellctl.clock import Clock
from cellctl.devices import Device

_STOP_SECONDS = 10.0
"""How long one device may take to come to its safe state, in the cell's time."""

_CLOSE_WALL_SECONDS = 30.0
"""How long letting go of a device may take. Wall time: ports and processes of this host know no other."""

CLEANUP_SECONDS = 30.0
"""How long a clean-up step may take that does not say so itself."""


async def stop_and_close(devices: Sequence[Device], clock: Clock, stopped: set[str]) -> list[str]:
    """Stop and close each device; what failed, in words. `stopped` gains the names of those that confirmed it."""
    troubles: list[str] = []
    for device in devices:
        safe = f"{device.name} could not be brought to its safe state"
        failed = await _tried(device.stop, clock.timeout(_STOP_SECONDS), safe)
        troubles += failed
        if not failed:
            stopped.add(device.name)
        free = f"{device.name} could not be let go of"
        troubles += await _tried(device.close, asyncio.timeout(_CLOSE_WALL_SECONDS), free)
    return troubles


async def _tried(
    action: Callable[[], Awaitable[None]], bound: AbstractAsyncContextManager[object], otherwise: str
) -> list[str]:
    """Do one action of the clean-up within `bound`; what came of it where it failed, begun by `otherwise`."""
    try:
        async with bound:
            await action()
    except Exception as failure:
        return [f"{otherwise}: {str(failure) or type(failure).__name__}"]
    return []
