"""The proxy's TCP end: several clients, all requests done one after another, each after a delay of the cell's time."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial
from typing import final

from sims.faults import Faults
from sims.simulator import Setup
from sims.tcp_server import Client, TcpServer
from sims.varproxy.files import FileDesk
from sims.varproxy.frames import Request, RequestStream

Answering = Callable[[Request, FileDesk], bytes]


@final
class Talk:
    """What one client asks. `files`: those that it has open."""

    def __init__(self, client: Client, server: ProxyServer, files: FileDesk) -> None:
        self.client, self.files = client, files
        self._server, self._stream = server, RequestStream()

    def feed(self, data: bytes) -> bool:
        """Take the requests in `data`; False where they are none."""
        for request in self._stream.feed(data):
            self._server.take(request, self)
        return not self._stream.broken


@final
class ProxyServer:
    """Answers requests of all clients, on `port` of 127.0.0.1."""

    def __init__(self, setup: Setup, answering: Answering, files: dict[str, bytes]) -> None:
        settings = setup.settings
        self._kernel, self._faults = setup.kernel, setup.faults
        self._answering, self._files = answering, files
        self._least_ns = round(settings["delay_least_ms"] * 1e6)
        self._most_ns = max(self._least_ns, round(settings["delay_most_ms"] * 1e6))
        self._draw = random.Random(f"{setup.cell.simulate.seed} varproxy delays")
        self._free_ns = 0
        self._cut = False
        self._end = TcpServer(setup.kernel, setup.wire, lambda client: Talk(client, self, FileDesk(self._files)))
        self.port = self._end.port
        self._subscribe(setup.faults)

    def take(self, request: Request, talk: Talk) -> None:
        """CrossComm does one request after the other, whoever asks."""
        delay = self._draw.randint(self._least_ns, self._most_ns)
        if slow := self._faults.active("varproxy.slow"):
            delay += round(slow.settings["delay_ms"] * 1e6)
        self._free_ns = max(self._free_ns, self._kernel.now) + delay
        self._kernel.at(self._free_ns, partial(self._do, request, talk))

    def close(self) -> None:
        """Hang up on every client, and stop listening."""
        self._end.close()

    def _subscribe(self, faults: Faults) -> None:
        faults.on_start("varproxy.gone", self._end.hang_up)
        faults.on_end("varproxy.gone", self._end.listen)
        faults.on_start("varproxy.cut", self._cut_next)

    def _do(self, request: Request, talk: Talk) -> None:
        if not talk.client.open:
            return
        data = self._answering(request, talk.files)
        if self._faults.active("varproxy.wrong_id"):
            data = ((request.number + 1) % 65536).to_bytes(2, "big") + data[2:]
        if self._faults.active("varproxy.garbage"):
            data = b"\x00\x01\x00\x00 no message"
        if self._cut:
            self._cut = False
            talk.client.send(data[: len(data) // 2])
            talk.client.close()
            return
        talk.client.send(data)

    def _cut_next(self) -> None:
        self._cut = True
