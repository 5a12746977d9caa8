"""RTDE, protocol versions 1 and 2: recipes of outputs and inputs, and the exchange of their packages.

A package: size (2), type (1), content; big-endian. Source: the maker's RTDE guide.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from sims.faults import Faults
from sims.ur._controller import Controller
from sims.ur._ports import Connection
from sims.ur._rtde_fields import FORMATS, Inputs, Outputs, inputs_of, outputs_of

REQUEST_VERSION, GET_URCONTROL_VERSION, TEXT_MESSAGE, DATA = b"V", b"v", b"M", b"U"
SETUP_OUTPUTS, SETUP_INPUTS, START, PAUSE = b"O", b"I", b"S", b"P"
VERSIONS = (1, 2)
"""Of the protocol."""
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
ERROR = 1
"""Level of a text message."""
HEAD = struct.Struct(">Hc")
LONGEST_NAMES = 2048
MOST_RECIPES = 255
SLOWEST_HZ = 1.0


@final
@dataclass(frozen=True, slots=True)
class Recipe:
    """Fields of a package, and its bytes."""

    names: tuple[str, ...]
    packing: struct.Struct
    counts: tuple[int, ...]

    @classmethod
    def of(cls, names: tuple[str, ...], types: list[str]) -> Recipe:
        """Of fields of these types."""
        counts = tuple(int(FORMATS[kind][:-1] or 1) for kind in types)
        return cls(names, struct.Struct(">" + "".join(FORMATS[kind] for kind in types)), counts)

    def values(self, data: bytes) -> dict[str, object]:
        """Name → value; a tuple of a vector. What follows the last field is not looked at."""
        flat = iter(self.packing.unpack_from(data))
        return {
            name: next(flat) if count == 1 else tuple(next(flat) for _ in range(count))
            for name, count in zip(self.names, self.counts, strict=True)
        }


@final
class RtdeServer:
    """What its clients share: the fields, and which input belongs to whom."""

    def __init__(self, controller: Controller) -> None:
        self.controller = controller
        self.faults: Faults = controller.faults
        self.outputs: Outputs = outputs_of(controller)
        self.inputs: Inputs = inputs_of(controller)
        self.owners: dict[str, RtdeClient] = {}
        self.clients: list[RtdeClient] = []

    def conversation(self, connection: Connection) -> RtdeClient:
        """A new client."""
        client = RtdeClient(self, connection)
        self.clients.append(client)
        return client

    def cycle(self, number: int) -> bool:
        """Send what is due; whether anybody waits for the next cycle."""
        started = [client for client in self.clients if client.started]
        for client in started:
            client.publish(number)
        return bool(started)

    def taken(self, name: str, by: RtdeClient) -> bool:
        """Whether an input belongs to another client."""
        if self.faults.active("ur.second_client") and "register" in name:
            return True
        return self.owners.get(name, by) is not by


@final
class RtdeClient:
    """One connection."""

    def __init__(self, server: RtdeServer, connection: Connection) -> None:
        self.started = False
        self._server, self._connection = server, connection
        self._version = 1
        self._rest = b""
        self._output: Recipe | None = None
        self._every = 1
        self._inputs: dict[int, Recipe] = {}
        self._answers: dict[bytes, Callable[[bytes], bytes | None]] = {
            REQUEST_VERSION: self._request_version,
            GET_URCONTROL_VERSION: lambda _: struct.pack(">4I", *server.controller.version),
            SETUP_OUTPUTS: self._setup_outputs,
            SETUP_INPUTS: self._setup_inputs,
            START: self._start,
            PAUSE: self._pause,
            TEXT_MESSAGE: self._text,
            DATA: self._data,
        }

    def feed(self, data: bytes) -> bool:
        """Take packages; False where they are none."""
        self._rest += data
        while len(self._rest) >= HEAD.size:
            size, kind = HEAD.unpack_from(self._rest)
            if size < HEAD.size:
                return False
            if len(self._rest) < size:
                return True
            content, self._rest = self._rest[HEAD.size : size], self._rest[size:]
            answer = self._answers.get(kind)
            if answer is None:
                self._message(f"unknown package type {kind!r}", ERROR)
                continue
            try:
                reply = answer(content)
            except (struct.error, UnicodeDecodeError):
                self._message(f"a package of type {kind.decode('latin-1')} has the wrong size", ERROR)
                continue
            if reply is not None:
                self._send(kind, reply)
        return True

    def ended(self) -> None:
        """Its inputs are free."""
        self.started = False
        server = self._server
        server.clients.remove(self)
        server.owners = {name: owner for name, owner in server.owners.items() if owner is not self}

    def publish(self, number: int) -> None:
        """The data package of this cycle, where one is due."""
        recipe = self._output
        if recipe is None or number % self._every or self._server.faults.active("ur.drop"):
            return
        flat: list[object] = []
        for name, count in zip(recipe.names, recipe.counts, strict=True):
            value = self._server.outputs[name][1]()
            flat.extend(value) if count > 1 else flat.append(value)
        head = b"\x01" if self._version > 1 else b""
        self._send(DATA, head + recipe.packing.pack(*flat), state=True)

    def _request_version(self, content: bytes) -> bytes:
        (version,) = struct.unpack(">H", content)
        if version in VERSIONS:
            self._version = version
        return bytes([version in VERSIONS])

    def _setup_outputs(self, content: bytes) -> bytes:
        frequency = 1e9 / self._server.controller.cycle_ns
        if self._version > 1:
            (wanted,) = struct.unpack_from(">d", content)
            content = content[8:]
            self._every = max(1, round(frequency / min(max(wanted, SLOWEST_HZ), frequency)))
        names = _names(content)
        types = [self._server.outputs[name][0] if name in self._server.outputs else NOT_FOUND for name in names]
        found = NOT_FOUND not in types and bool(names)
        self._output = Recipe.of(names, types) if found else None
        return (bytes([found]) if self._version > 1 else b"") + ",".join(types).encode()

    def _setup_inputs(self, content: bytes) -> bytes:
        server, names = self._server, _names(content)
        types = [
            NOT_FOUND if name not in server.inputs else IN_USE if server.taken(name, self) else server.inputs[name][0]
            for name in names
        ]
        number = len(self._inputs) + 1
        if NOT_FOUND in types or IN_USE in types or not names or number > MOST_RECIPES:
            number = 0
        else:
            self._inputs[number] = Recipe.of(names, types)
            server.owners.update(dict.fromkeys(names, self))
        return bytes([number]) + ",".join(types).encode()

    def _start(self, content: bytes) -> bytes:
        self.started = self._output is not None or bool(self._inputs)
        self._server.controller.wake()
        return bytes([self.started])

    def _pause(self, content: bytes) -> bytes:
        self.started = False
        return b"\x01"

    def _text(self, content: bytes) -> None:
        """A message of the client goes to the log."""
        text = content[1 : 1 + content[0]] if self._version > 1 and content else content
        self._server.controller.messages.log.append(text.decode("utf-8", "replace"))

    def _data(self, content: bytes) -> None:
        if self._server.faults.active("ur.stall"):
            return
        recipe = self._inputs.get(content[0]) if content else None
        if recipe is None:
            self._message("a data package of no recipe", ERROR)
            return
        values = recipe.values(content[1:])
        controller = self._server.controller
        for name, value in values.items():
            self._server.inputs[name][1](value)
        controller.runtime.updated(values, controller.kernel.now)

    def _message(self, text: str, level: int) -> None:
        if self._version > 1:
            source = b"RTDE"
            body = bytes([len(text)]) + text.encode() + bytes([len(source)]) + source + bytes([level])
        else:
            body = bytes([level]) + text.encode()
        self._send(TEXT_MESSAGE, body)

    def _send(self, kind: bytes, content: bytes, *, state: bool = False) -> None:
        self._connection.send(HEAD.pack(HEAD.size + len(content), kind) + content, state=state)


def _names(content: bytes) -> tuple[str, ...]:
    """A list of names; a comma may end it."""
    return tuple(name.strip() for name in content[:LONGEST_NAMES].decode().split(",") if name.strip())
