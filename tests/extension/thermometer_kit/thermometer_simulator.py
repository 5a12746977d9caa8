"""Simulator of the invented thermometer, with one setting, one event and one fault."""

import socket

from sims.simulator import FaultKind, Setting, Simulator, with_settings

ANSWER_NS = 5_000_000
READ, SILENT = "thermometer.read", "thermometer.silent"


class Server:
    """Listens on a free port; the temperature rises by 0.1 K with each reading."""

    def __init__(self, setup):
        self._setup, self._peer, self._readings = setup, None, 0
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self.address = with_settings(setup.address, f"127.0.0.1:{self._listener.getsockname()[1]}")
        self.requests = {}
        setup.kernel.watch(self._listener, self._accept)

    def _accept(self):
        self._peer, _ = self._listener.accept()
        self._peer.setblocking(False)
        self._setup.wire.opened()
        self._setup.kernel.watch(self._peer, self._receive)

    def _receive(self):
        data = self._peer.recv(4096)
        if not data:
            self._setup.kernel.unwatch(self._peer)
            self._setup.wire.cut()
            return
        for question in data.decode().split():
            self._setup.kernel.after(ANSWER_NS, lambda question=question: self._answer(question))
        self._setup.wire.read(len(data))

    def _answer(self, question):
        if question == "READ":
            self._setup.faults.announce(READ)
            self._readings += 1
        if self._setup.faults.active(SILENT):
            return
        celsius = self._setup.settings["start"] + 0.1 * self._readings
        line = f"{celsius:.2f}\n" if question == "READ" else "SIM-THERMO-1\n"
        self._setup.wire.wrote(self._peer.send(line.encode()))

    def close(self):
        for line in (self._peer, self._listener):
            if line:
                self._setup.kernel.unwatch(line)
                line.close()


SIMULATOR = Simulator(
    schemes=("thermometer+tcp",),
    start=Server,
    section="thermometer",
    settings=(Setting("start", "number", 20.0, -50.0, what="Temperature at the start, °C."),),
    faults=(FaultKind(SILENT, "it answers no more"),),
    events={READ: "a temperature is asked for"},
)
