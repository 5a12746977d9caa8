"""A serial port, for all drivers of serial devices: its address, exclusive opening, reads with a time limit.

Every failure to open is reported with its cure.
"""

from __future__ import annotations

import errno
import os
import select
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, final

from cellctl.devices import Address, DeviceUnreachable

if TYPE_CHECKING:
    from serial import Serial

_READ_BOUND_S = 0.05
"""Wall time after which a read without data returns, so that the thread can be ended."""
_WRITE_BOUND_S = 0.2
"""Wall time after which a line that cannot be sent counts as lost."""

_CURES = {
    errno.ENOENT: "is the {device} plugged in? `ls /dev/serial/by-id` shows the ports that are there",
    errno.EACCES: "let your user use serial ports: `sudo usermod -aG dialout $USER`, then log in again",
    errno.EBUSY: "another program has it open; `fuser -v {path}` names it",
    errno.EAGAIN: "another program has it open; `fuser -v {path}` names it",
}
_NO_PORT_CURE = "the address has to name a serial port, as `{example}`"

_BAUDS = range(1200, 4_000_001)


@final
@dataclass(frozen=True, slots=True)
class SerialPlace:
    """The port in a device's address: `path` (`/dev/ttyACM0`), `baud`; `example`: a correct address."""

    path: str
    baud: int
    example: str

    @classmethod
    def of(cls, address: Address, default_baud: int) -> Self:
        """The port in `SCHEME:///PATH?baud=…`. Raises ValueError for a host, no path, or an impossible baud rate."""
        example = f"{address.scheme}:///dev/ttyACM0?baud={default_baud}"
        if address.host or address.port is not None:
            raise ValueError(f"'{address}' has a host; a serial port's address has three slashes, as {example}")
        if not address.path.strip("/"):
            raise ValueError(f"'{address}' names no serial port, as {example}")
        baud = address.query.get("baud", str(default_baud))
        if not (baud.isascii() and baud.isdigit() and int(baud) in _BAUDS):
            raise ValueError(f"'{address}': baud has to be a whole number from 1200 to 4000000")
        return cls(address.path, int(baud), example)

    def __str__(self) -> str:
        return f"{self.path} at {self.baud} baud"


@final
class SerialPort:
    """An open serial port, 8N1. One thread or loop reads; close it after its reading has ended."""

    def __init__(self, serial: Serial) -> None:
        self._serial = serial

    def fileno(self) -> int:
        """The file descriptor, for a loop's `add_reader`."""
        return self._serial.fileno()

    def read(self) -> bytes:
        """The received bytes; empty after 50 ms (wall) without data. Raises OSError if the port was lost."""
        first: bytes = self._serial.read(1)
        if not first:
            return b""
        return first + bytes(self._serial.read(self._serial.in_waiting))

    def write(self, data: bytes) -> None:
        """Send `data`. Raises OSError if the port was lost or accepts no data for 200 ms (wall).

        Not pyserial's write: if its thread is delayed, it reports a line as lost that the port took at once.
        """
        line = self._serial.fileno()
        while data:
            _, ready, _ = select.select([], [line], [], _WRITE_BOUND_S)
            if not ready:
                raise TimeoutError("write timeout")
            with suppress(BlockingIOError):  # another reader was first: wait again
                data = data[os.write(line, data) :]

    def waiting(self) -> bool:
        """Whether unread data wait; false if the port was lost."""
        try:
            return bool(self._serial.in_waiting)
        except (OSError, TypeError):
            return False

    def wake(self) -> None:
        """End a read in progress."""
        with suppress(OSError, TypeError):
            self._serial.cancel_read()

    def close(self) -> None:
        """Close the port."""
        with suppress(OSError, TypeError):
            self._serial.close()


def open_port(device: str, place: SerialPlace) -> SerialPort:
    """Open the port of `device` exclusively. Raises DeviceUnreachable, with the cure."""
    import termios  # lazily, as it and pyserial are only needed to open a port

    from serial import Serial  # POSIX alone

    try:
        return SerialPort(Serial(place.path, place.baud, timeout=_READ_BOUND_S, exclusive=True))
    except (OSError, ValueError, termios.error) as error:
        code = getattr(error, "errno", None) or _errno_in(error)
        reason = errno.errorcode.get(code or 0, str(error))
        cure = _CURES.get(code or 0, _NO_PORT_CURE).format(device=device, path=place.path, example=place.example)
        raise DeviceUnreachable(device, f"{place.path} cannot be opened ({reason})", cure) from error


def _errno_in(error: BaseException) -> int | None:
    """The error number of the cause of `error`: pyserial hides some in its text."""
    cause = error.__context__
    return cause.args[0] if cause and cause.args and isinstance(cause.args[0], int) else None
