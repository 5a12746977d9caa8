"""The serial port: opened exclusively, read with a bound, and every way of not opening told with its cure."""

from __future__ import annotations

import errno
import os
import select
import termios
from contextlib import suppress
from typing import TYPE_CHECKING, final

from cellctl.devices import DeviceUnreachable

if TYPE_CHECKING:
    from serial import Serial

_READ_BOUND_S = 0.05
"""Wall time after which a read with nothing to read returns, so that the thread can be ended."""
_WRITE_BOUND_S = 0.2
"""Wall time after which a line that cannot be sent says that nobody takes it."""

_CURES = {
    errno.ENOENT: "is the probe plugged in? `ls /dev/serial/by-id` shows the ports that are there",
    errno.EACCES: "let your user use serial ports: `sudo usermod -aG dialout $USER`, then log in again",
    errno.EBUSY: "another program has it open; `fuser -v {path}` names it",
    errno.EAGAIN: "another program has it open; `fuser -v {path}` names it",
}
_NO_PORT_CURE = "the address has to name a serial port, as `contact+serial:///dev/ttyACM0?baud=250000`"


@final
class SerialPort:
    """An open serial port, 8N1. Reading is for one thread; closing comes after that thread has ended."""

    def __init__(self, serial: Serial) -> None:
        self._serial = serial

    def read(self) -> bytes:
        """What has come; empty after 50 ms (wall) without anything. Raises OSError where the port is gone."""
        first: bytes = self._serial.read(1)
        if not first:
            return b""
        return first + bytes(self._serial.read(self._serial.in_waiting))

    def write(self, data: bytes) -> None:
        """Send `data`. Raises OSError where the port is gone or takes nothing for 200 ms (wall).

        Not pyserial's write: it calls a line lost that the port took at once, where its thread was kept waiting since.
        """
        line = self._serial.fileno()
        while data:
            _, ready, _ = select.select([], [line], [], _WRITE_BOUND_S)
            if not ready:
                raise TimeoutError("write timeout")
            with suppress(BlockingIOError):  # somebody else was quicker: wait anew
                data = data[os.write(line, data) :]

    def waiting(self) -> bool:
        """Whether something has come that is not read yet; false where the port is gone."""
        try:
            return bool(self._serial.in_waiting)
        except (OSError, TypeError):
            return False

    def wake(self) -> None:
        """End a read that is under way."""
        with suppress(OSError, TypeError):
            self._serial.cancel_read()

    def close(self) -> None:
        """Let go of the port."""
        with suppress(OSError, TypeError):
            self._serial.close()


def open_port(device: str, path: str, baud: int) -> SerialPort:
    """Open `path` exclusively. Raises DeviceUnreachable, with the cure."""
    from serial import Serial  # lazily: only who talks to a probe pays for it

    try:
        return SerialPort(
            Serial(path, baud, timeout=_READ_BOUND_S, exclusive=True),
        )
    except (OSError, ValueError, termios.error) as error:
        code = getattr(error, "errno", None) or _errno_in(error)
        reason = errno.errorcode.get(code or 0, str(error))
        cure = _CURES.get(code or 0, _NO_PORT_CURE).format(path=path)
        raise DeviceUnreachable(device, f"{path} cannot be opened ({reason})", cure) from error


def _errno_in(error: BaseException) -> int | None:
    """The error number of what `error` was raised from: pyserial hides some in its text."""
    cause = error.__context__
    return cause.args[0] if cause and cause.args and isinstance(cause.args[0], int) else None
