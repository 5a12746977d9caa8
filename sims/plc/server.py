"""The PLC's TCP end: several clients, each request answered after a delay of the cell's time."""

from __future__ import annotations

import random
from functools import partial
from typing import final

from sims.kernel import Kernel
from sims.plc.description import low_first, unit_of
from sims.plc.frames import Frame, FrameStream
from sims.plc.functions import NO_TARGET, answer, exception
from sims.plc.process import PlcProgram
from sims.simulator import Request, Setup, with_settings
from sims.tcp_server import Client, TcpServer


@final
class Talk:
    """What one client asks: its requests are done one after another, each after its own delay."""

    def __init__(self, kernel: Kernel, client: Client, server: PlcServer) -> None:
        self._kernel, self._client, self._server = kernel, client, server
        self._stream = FrameStream()
        self._free_ns = 0

    def feed(self, data: bytes) -> bool:
        """Take the requests in `data`; False where they are no Modbus."""
        for frame in self._stream.feed(data):
            self._free_ns = max(self._free_ns, self._kernel.now) + self._server.delay_ns()
            self._kernel.at(self._free_ns, partial(self._do, frame))
        return not self._stream.broken

    def _do(self, request: Frame) -> None:
        if self._client.open:
            self._client.send(Frame(request.transaction, request.unit, self._server.answer(request)).encode())


@final
class PlcServer:
    """Answers Modbus requests on a free port of 127.0.0.1.

    Fault `plc.gone`: every connection is closed, and a new one finds nobody who answers.
    """

    def __init__(self, setup: Setup) -> None:
        settings, seed = setup.settings, setup.cell.simulate.seed
        self._unit = unit_of(setup.address)
        self._least_ns = round(settings["delay_least_ms"] * 1e6)
        self._most_ns = max(self._least_ns, round(settings["delay_most_ms"] * 1e6))
        self._draw = random.Random(f"{seed} plc delays")
        clamp_ns = round(settings["clamp_ms"] * 1e6)
        words = low_first(setup.address)
        self.program = PlcProgram(setup.kernel, setup.scene, setup.faults, seed, clamp_ns, low_first=words)
        self._end = TcpServer(setup.kernel, setup.wire, lambda client: Talk(setup.kernel, client, self))
        self.port = self._end.port
        self.address = with_settings(setup.address, f"127.0.0.1:{self.port}")
        self.requests: dict[str, Request] = {}
        setup.faults.on_start("plc.gone", self._end.hang_up)
        setup.faults.on_end("plc.gone", self._end.listen)

    def delay_ns(self) -> int:
        """Time from a request to its answer."""
        return self._draw.randint(self._least_ns, self._most_ns)

    def answer(self, request: Frame) -> bytes:
        """The answer's PDU. A unit that is not there is answered as by a gateway: 0B."""
        if request.unit != self._unit:
            return exception(request.pdu, NO_TARGET)
        return answer(request.pdu, self.program)

    def close(self) -> None:
        """Hang up on every client, and stop listening."""
        self._end.close()
