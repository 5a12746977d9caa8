"""A controller's end of the transfer channel with tables behind it, which may hang up at any byte."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from cellctl.clock import WallClock
from drivers.kuka_rsi.eki.channel import EkiChannel
from drivers.kuka_rsi.eki.tables import TableChannel
from tests.helpers.controller_tables import ControllerTables

COMMAND = re.compile(rb'<Cmd Id="(\d+)" Op="(\w+)">(.*?)</Cmd>', re.DOTALL)
NEVER = 1 << 30


@dataclass
class CutLine:
    """A controller's end of the channel that hangs up after `hears` bytes received or `says` bytes sent, or in place of
    answering the operation `deaf`.

    `heard_before`, `said_before`: per operation, bytes heard and said before its first command.
    """

    tables: ControllerTables
    hears: int = NEVER
    says: int = NEVER
    deaf: str = ""

    def __post_init__(self) -> None:
        self.heard = self.said = 0
        self.heard_before: dict[str, int] = {}
        self.said_before: dict[str, int] = {}

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        text = b""
        while self.heard < self.hears and self.said < self.says:
            data = await reader.read(min(4096, self.hears - self.heard))
            if not data:
                break
            self.heard += len(data)
            text += data
            while (match := COMMAND.match(text)) and self.said < self.says:
                text = text[match.end() :]
                self._do(match, self.heard - len(text) - len(match[0]), writer)
        writer.close()

    def _do(self, command: re.Match[bytes], heard_before: int, writer: asyncio.StreamWriter) -> None:
        operation = command[2].decode()
        self.heard_before.setdefault(operation, heard_before)
        self.said_before.setdefault(operation, self.said)
        code, more = self.tables.answer(operation, command[3].decode())
        if operation == self.deaf:
            self.says = self.said
        reply = f'<Rep Id="{command[1].decode()}" Code="{code}" Text="">{more}</Rep>'.encode()
        reply = reply[: self.says - self.said]
        self.said += len(reply)
        writer.write(reply)


@asynccontextmanager
async def channel_to(line: CutLine) -> AsyncIterator[TableChannel]:
    server = await asyncio.start_server(line.serve, "127.0.0.1", 0)
    eki = EkiChannel("robot", server.sockets[0].getsockname()[:2], WallClock())
    try:
        await eki.open()
        yield TableChannel("robot", eki, line.tables.serial)
    finally:
        await eki.close()
        server.close()
        await server.wait_closed()
