"""TCP connections to controllers: opened within a time, and closed, while the cell's time stands."""

from __future__ import annotations

import asyncio
from contextlib import suppress

from cellctl.clock import Clock, Wire
from cellctl.devices import DeviceUnreachable

_OPEN_S = 5.0


async def connected(
    device: str, place: tuple[str, int], clock: Clock, *, peer: str, cure: str
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter, Wire]:
    """Reader and writer of a new connection to host and port, and its wire. peer: the missing part, for the message.

    Raises DeviceUnreachable.
    """
    host, port = place
    try:
        with clock.standing():
            async with asyncio.timeout(_OPEN_S):  # wall time: the host's network stack uses it
                reader, writer = await asyncio.open_connection(host, port)
            return reader, writer, clock.wire(device)
    except (OSError, TimeoutError) as error:
        raise DeviceUnreachable(device, f"no {peer} at {host}:{port} ({error or 'no answer'})", cure) from error


async def hang_up(writer: asyncio.StreamWriter, clock: Clock) -> None:
    """Close the connection; one that broke before is closed too."""
    writer.close()
    with suppress(OSError), clock.standing():
        await writer.wait_closed()
