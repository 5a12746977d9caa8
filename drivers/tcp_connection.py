"""TCP connections to controllers: opened within a time, and closed, while the cell's time stands."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
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
        raise DeviceUnreachable(device, f"no {peer} at {host}:{port} ({_reason(error)})", cure) from error


def _reason(error: Exception) -> str:
    """The system's words for a failed connection, without the numbers and tuples that asyncio adds."""
    if isinstance(error, socket.gaierror):
        return "no host of this name is known"
    number = getattr(error, "errno", None)
    if not number and "refused" in str(error):  # of a name with several addresses, asyncio joins the texts
        number = errno.ECONNREFUSED
    return os.strerror(number).lower() if number else "no answer"


async def hang_up(writer: asyncio.StreamWriter, clock: Clock) -> None:
    """Close the connection; one that broke before is closed too."""
    writer.close()
    with suppress(OSError), clock.standing():
        await writer.wait_closed()
