"""Functions of URScript for registers, inputs and outputs, messages and sockets, called as in the script manual."""

from __future__ import annotations

import re
import socket
import struct
from collections.abc import Callable
from contextlib import suppress
from typing import final

from sims.ur._board import CONFIGURABLE, STANDARD, TOOL
from sims.ur._controller import Controller
from sims.ur._script_expressions import Halt, Running, ScriptError, Value, shown

TIMEOUT_S = 2.0
"""Of a read or a connection where the program states none."""
FLOATS_MOST = 30
BYTES_MOST = 255


@final
class IoFunctions:
    """Each public method is a function of URScript."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

    def read_input_integer_register(self, address: int) -> int:
        return self._controller.board.inputs.ints[_place(address)]

    def read_input_float_register(self, address: int) -> float:
        return self._controller.board.inputs.doubles[_place(address)]

    def read_input_boolean_register(self, address: int) -> bool:
        return self._controller.board.inputs.bits[_place(address)]

    def read_output_integer_register(self, address: int) -> int:
        return self._controller.board.outputs.ints[_place(address)]

    def read_output_float_register(self, address: int) -> float:
        return self._controller.board.outputs.doubles[_place(address)]

    def read_output_boolean_register(self, address: int) -> bool:
        return self._controller.board.outputs.bits[_place(address)]

    def write_output_integer_register(self, address: int, value: int) -> None:
        """32 bits with a sign."""
        self._controller.board.outputs.ints[_place(address)] = (int(value) + 2**31) % 2**32 - 2**31

    def write_output_float_register(self, address: int, value: float) -> None:
        self._controller.board.outputs.doubles[_place(address)] = float(value)

    def write_output_boolean_register(self, address: int, value: bool) -> None:
        self._controller.board.outputs.bits[_place(address)] = bool(value)

    def rtde_set_watchdog(self, variable_name: str, min_frequency: float, action: str = "pause") -> None:
        controller = self._controller
        controller.runtime.set_watchdog(variable_name, float(min_frequency), action, controller.kernel.now)

    def set_digital_out(self, n: int, b: bool) -> None:
        """0 to 7 standard, 8 and 9 at the tool."""
        if n < 8:
            self._set(STANDARD, n, b)
        else:
            self._set(TOOL, n - 8, b)

    def set_standard_digital_out(self, n: int, b: bool) -> None:
        self._set(STANDARD, n, b)

    def set_configurable_digital_out(self, n: int, b: bool) -> None:
        self._set(CONFIGURABLE, n, b)

    def set_tool_digital_out(self, n: int, b: bool) -> None:
        self._set(TOOL, n, b)

    def get_digital_in(self, n: int) -> bool:
        """0 to 7 standard, 8 and 9 at the tool."""
        return self._in(STANDARD, n) if n < 8 else self._in(TOOL, n - 8)

    def get_standard_digital_in(self, n: int) -> bool:
        return self._in(STANDARD, n)

    def get_configurable_digital_in(self, n: int) -> bool:
        return self._in(CONFIGURABLE, n)

    def get_tool_digital_in(self, n: int) -> bool:
        return self._in(TOOL, n)

    def get_digital_out(self, n: int) -> bool:
        return self._out(STANDARD, n) if n < 8 else self._out(TOOL, n - 8)

    def get_standard_digital_out(self, n: int) -> bool:
        return self._out(STANDARD, n)

    def get_configurable_digital_out(self, n: int) -> bool:
        return self._out(CONFIGURABLE, n)

    def get_tool_digital_out(self, n: int) -> bool:
        return self._out(TOOL, n)

    def set_standard_analog_out(self, n: int, f: float) -> None:
        self._controller.board.set_analog(n, float(f))

    def set_tool_voltage(self, voltage: int) -> None:
        if voltage not in (0, 12, 24):
            raise ScriptError(f"set_tool_voltage: 0, 12 or 24 is expected, not {shown(voltage)}")
        self._controller.board.tool_voltage = voltage

    def textmsg(self, s1: Value, s2: Value = "") -> None:
        self._controller.messages.text(shown(s1) + shown(s2))

    def popup(
        self, s: Value, title: str = "Popup", warning: bool = False, error: bool = False, blocking: bool = False
    ) -> Running:
        """A blocking one holds the thread until it is closed."""
        controller = self._controller
        controller.popup = shown(s)
        controller.messages.popup(title, shown(s), warning=warning, error=error, blocking=blocking)
        while blocking and controller.popup:
            yield

    def halt(self) -> None:
        """End the program."""
        raise Halt

    def _set(self, kind: tuple[int, int], n: int, b: bool) -> None:
        first, count = kind
        if not 0 <= n < count:
            raise ScriptError(f"there is no digital output {n}")
        self._controller.board.set_digital(1 << n, int(b) << n, first, count)

    def _in(self, kind: tuple[int, int], n: int) -> bool:
        return bool(self._controller.digital_in() >> _digital(kind, n) & 1)

    def _out(self, kind: tuple[int, int], n: int) -> bool:
        return bool(self._controller.board.digital_out >> _digital(kind, n) & 1)


def _place(address: int) -> int:
    """Of a register. Raises IndexError."""
    if isinstance(address, bool) or address < 0:
        raise IndexError(f"there is no register {address}")
    return address


def _digital(kind: tuple[int, int], n: int) -> int:
    first, count = kind
    if not 0 <= n < count:
        raise ScriptError(f"there is no digital input or output {n}")
    return first + n


@final
class SocketFunctions:
    """The controller's connections to hosts, by their names: clients of servers that the hosts run."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._sockets: dict[str, _HostSocket] = {}

    def socket_open(self, address: str, port: int, socket_name: str = "socket_0") -> Running:
        """Whether the host has taken the call."""
        self.socket_close(socket_name)
        stream = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        stream.setblocking(False)
        until = self._controller.kernel.now + round(TIMEOUT_S * 1e9)
        code = _GOING_ON[0]
        while code in _GOING_ON and self._controller.kernel.now < until:
            try:
                code = stream.connect_ex((address, port))
            except OSError:  # no such address
                break
            if code in _GOING_ON:
                yield
        if code not in _CONNECTED:
            stream.close()
            return False
        stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._sockets[socket_name] = _HostSocket(stream)
        return True

    def socket_close(self, socket_name: str = "socket_0") -> None:
        if found := self._sockets.pop(socket_name, None):
            found.stream.close()

    def socket_send_string(self, str: Value, socket_name: str = "socket_0") -> bool:  # noqa: A002
        return self._send(shown(str).encode(), socket_name)

    def socket_send_line(self, str: Value, socket_name: str = "socket_0") -> bool:  # noqa: A002
        return self._send(shown(str).encode() + b"\n", socket_name)

    def socket_send_byte(self, value: int, socket_name: str = "socket_0") -> bool:
        return self._send(bytes([value & 0xFF]), socket_name)

    def socket_send_int(self, value: int, socket_name: str = "socket_0") -> bool:
        return self._send(struct.pack(">i", value), socket_name)

    def socket_read_line(self, socket_name: str = "socket_0", timeout: float = TIMEOUT_S) -> Running:
        """A line without its end; an empty text after the time."""

        def line(found: _HostSocket) -> str | None:
            head, end, rest = found.data.partition(b"\n")
            if not end:
                return None
            found.data = rest
            return head.decode("utf-8", "replace").rstrip("\r")

        return (yield from self._read(socket_name, timeout, line, ""))

    def socket_read_string(
        self,
        socket_name: str = "socket_0",
        prefix: str = "",
        suffix: str = "",
        interpret_escape: bool = False,
        timeout: float = TIMEOUT_S,
    ) -> Running:
        """Between prefix and suffix; without them all that is there."""

        def text(found: _HostSocket) -> str | None:
            begin = found.data.find(prefix.encode())
            if begin < 0 or not found.data:
                return None
            rest = found.data[begin + len(prefix) :]
            head, end, after = rest.partition(suffix.encode()) if suffix else (rest, b"all", b"")
            if not end or not head:
                return None
            found.data = after
            return head.decode("utf-8", "replace")

        return (yield from self._read(socket_name, timeout, text, ""))

    def socket_read_ascii_float(
        self, number: int, socket_name: str = "socket_0", timeout: float = TIMEOUT_S
    ) -> Running:
        """(1.5, 2) → [2, 1.5, 2]: how many came, then the numbers; [0, nan, …] after the time."""
        if not 0 < number <= FLOATS_MOST:
            raise ScriptError(f"socket_read_ascii_float: 1 to {FLOATS_MOST} numbers")

        def floats(found: _HostSocket) -> list[Value] | None:
            match = re.search(rb"\(([^()]*)\)", found.data)
            if match is None:
                return None
            found.data = found.data[match.end() :]
            values = [float(part) for part in match[1].split(b",") if part.strip()][:number]
            return [len(values), *values, *[float("nan")] * (number - len(values))]

        return (yield from self._read(socket_name, timeout, floats, [0, *[float("nan")] * number]))

    def socket_read_byte_list(self, number: int, socket_name: str = "socket_0", timeout: float = TIMEOUT_S) -> Running:
        """How many came, then the bytes."""
        if not 0 < number <= BYTES_MOST:
            raise ScriptError(f"socket_read_byte_list: 1 to {BYTES_MOST} bytes")

        def numbers(found: _HostSocket) -> list[Value] | None:
            if len(found.data) < number:
                return None
            head, found.data = found.data[:number], found.data[number:]
            return [number, *head]

        return (yield from self._read(socket_name, timeout, numbers, [0, *[-1] * number]))

    def socket_read_binary_integer(
        self, number: int, socket_name: str = "socket_0", timeout: float = TIMEOUT_S
    ) -> Running:
        """How many came, then whole numbers of four bytes."""

        def numbers(found: _HostSocket) -> list[Value] | None:
            if len(found.data) < 4 * number:
                return None
            head, found.data = found.data[: 4 * number], found.data[4 * number :]
            return [number, *struct.unpack(f">{number}i", head)]

        return (yield from self._read(socket_name, timeout, numbers, [0, *[-1] * number]))

    def close_all(self) -> None:
        """The program has ended."""
        for name in list(self._sockets):
            self.socket_close(name)

    def _send(self, data: bytes, name: str) -> bool:
        found = self._sockets.get(name)
        with suppress(OSError):
            return found is not None and found.stream.send(data) == len(data)
        return False

    def _read(self, name: str, timeout: float, take: Callable[[_HostSocket], Value], none: Value) -> Running:
        """What `take` finds in the bytes that have come, as soon as it finds it; `none` after the time."""
        until = self._controller.kernel.now + round(timeout * 1e9) if timeout > 0.0 else None
        while found := self._sockets.get(name):
            with suppress(OSError):
                found.data += found.stream.recv(65536)
            value = take(found)
            if value is not None:
                return value
            if until is not None and self._controller.kernel.now >= until:
                break
            yield
        return none


_GOING_ON = (115, 114)
"""EINPROGRESS, EALREADY."""
_CONNECTED = (0, 106)
"""Connected now, or already (EISCONN)."""


@final
class _HostSocket:
    """A connection, and what has come and has not been read."""

    def __init__(self, stream: socket.socket) -> None:
        self.stream, self.data = stream, b""
