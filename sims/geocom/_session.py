"""The serial line's characters cut into requests; one request after another, read, done and answered."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from typing import final

from sims.faults import Faults
from sims.geocom import _protocol
from sims.geocom._instrument import Instrument, Power
from sims.geocom._protocol import LONGEST, Answer, Code, Procedures, Request, Step, Work, WrongChecksum, WrongFormat
from sims.kernel import Event, Kernel
from sims.wires import wire_time_ns

LF, ABORT = 0x0A, ord("c")


@final
class Receiver:
    """Each is called when the last of its characters has come over the line.

    line: a request without its end. clear: a line feed that ends no line: what waits is to be forgotten. abort: the
    single character `c`. overrun: the end of a line that was longer than the buffer.
    """

    def __init__(
        self,
        kernel: Kernel,
        baud: int,
        *,
        line: Callable[[bytes], object],
        clear: Callable[[], object],
        abort: Callable[[], object],
        overrun: Callable[[], object],
    ) -> None:
        self._kernel = kernel
        self._baud = baud
        self._line, self._clear, self._abort, self._overrun = line, clear, abort, overrun
        self._begun = bytearray()
        self._too_long = False
        self._free_at = 0

    def feed(self, chunk: bytes) -> None:
        """Characters that the host has put into its adapter now."""
        start = max(self._free_at, self._kernel.now)
        self._free_at = start + wire_time_ns(len(chunk), self._baud)
        for count, character in enumerate(chunk, 1):
            action = self._take(character)
            if action is not None:
                self._kernel.at(start + wire_time_ns(count, self._baud), action)

    def forget(self) -> None:
        """A line that has begun is forgotten."""
        self._begun.clear()
        self._too_long = False

    def _take(self, character: int) -> Callable[[], object] | None:
        if character == LF:
            return self._end()
        if character == ABORT and not self._begun:
            return self._abort
        if len(self._begun) < LONGEST:
            self._begun.append(character)
        else:
            self._too_long = True
            self._begun[-1] = character  # the line's end is still to be seen
        return None

    def _end(self) -> Callable[[], object]:
        line, too_long = bytes(self._begun), self._too_long
        self.forget()
        if not line.endswith(b"\r"):
            return self._clear
        return self._overrun if too_long else partial(self._line, line[:-1])


@final
class Sender:
    """Writes a line when its last character has come over the line.

    Faults: missing, late, doubled, garbled. `write` gives a line to the host.
    """

    def __init__(self, kernel: Kernel, faults: Faults, baud: int, write: Callable[[bytes], object]) -> None:
        self._kernel = kernel
        self._faults = faults
        self._baud = baud
        self._write = write
        self._free_at = 0
        self._session = 0
        self._lines = 0

    def send(self, line: bytes, delay_ns: int = 0) -> None:
        """Send a line, `delay_ns` from now on at the earliest."""
        if self._faults.active("tracker.missing"):
            return
        late = self._faults.active("tracker.late")
        begin = self._kernel.now + delay_ns + (round(late.settings["by_ms"] * 1e6) if late else 0)
        for _ in range(2 if self._faults.active("tracker.doubled") else 1):
            end = max(self._free_at, begin) + wire_time_ns(len(line), self._baud)
            self._free_at = end
            self._kernel.at(end, partial(self._deliver, self._damaged(line), self._session))

    def cut(self) -> None:
        """The host has hung up: what is not out is lost."""
        self._session += 1
        self._free_at = 0

    def _deliver(self, line: bytes, session: int) -> None:
        if session == self._session:
            self._write(line)

    def _damaged(self, line: bytes) -> bytes:
        """The line; while the fault is active, each n-th with one bit of its middle character turned over."""
        fault = self._faults.active("tracker.garbled")
        if fault is None:
            return line
        self._lines = (self._lines + 1) % fault.settings["every"]
        middle = len(line) // 2
        return line if self._lines else line[:middle] + bytes([line[middle] ^ 1]) + line[middle + 1 :]


WAKE_UP = 111
ABORTED = b"?" + _protocol.TERMINATOR


@final
class Session:
    """Requests in, replies out. send(line): a reply is ready; stop: breaks off what the instrument does."""

    def __init__(
        self,
        kernel: Kernel,
        faults: Faults,
        instrument: Instrument,
        procedures: Procedures,
        *,
        send: Callable[[bytes], object],
        stop: Callable[[], object],
    ) -> None:
        self._kernel = kernel
        self._faults = faults
        self._instrument = instrument
        self._procedures = procedures
        self._send = send
        self._stop = stop
        self._waiting: deque[bytes] = deque()
        self._working: Event | None = None

    def take(self, line: bytes) -> None:
        """A line of the host. A blank one is ignored; one that comes while the instrument works waits its turn."""
        if not line:
            return
        if self._working is None:
            self._do(line)
        elif sum(map(len, self._waiting)) + len(line) <= LONGEST:
            self._waiting.append(line)
        else:
            self.overrun()

    def overrun(self) -> None:
        """The buffer was full: the request is discarded."""
        self._send(_protocol.reply(0, ("0",), com=Code.COM_OVERRUN))

    def clear(self) -> None:
        """Forget the requests that wait."""
        self._waiting.clear()

    def abort(self) -> None:
        """The character `c`: break off the running request, which gets no other answer than `?`."""
        if self._working is not None:
            self._working.cancel()
            self._working = None
            self._stop()
        self._send(ABORTED)
        self._next()

    def _next(self) -> None:
        while self._working is None and self._waiting:
            self._do(self._waiting.popleft())

    def _do(self, line: bytes) -> None:
        try:
            request = _protocol.parse_request(line)
        except WrongFormat:
            self._send(_protocol.reply(0, ("0",), com=Code.COM_WRONG_FORMAT))
        except WrongChecksum:
            self._send(_protocol.reply(0, ("0",), com=Code.COM_SRVR_RX_CHECKSUM_ERR, checked=True))
        else:
            self._run(request)

    def _run(self, request: Request) -> None:
        procedure = self._procedures.get(request.rpc)
        if procedure is None:
            self._refuse(request, Code.COM_PROC_UNAVAIL)
        elif self._instrument.power is not Power.ON and request.rpc != WAKE_UP:
            asleep = self._instrument.power is Power.ASLEEP
            self._refuse(request, Code.COM_SRVR_IS_SLEEPING if asleep else Code.COM_SRVR_IS_OFF)
        elif self._faults.active("tracker.busy") and (code := _busy(request.rpc)):
            self._answer(request, Answer(code))
        else:
            self._go_on(request, procedure.call(request.parameters))

    def _go_on(self, request: Request, step: Step) -> None:
        self._working = None
        if isinstance(step, Work):
            self._working = self._kernel.after(step.duration_ns, lambda: self._go_on(request, step.then()))
        else:
            self._answer(request, step)
            self._next()

    def _answer(self, request: Request, answer: Answer) -> None:
        digits = self._instrument.configuration.digits
        parts = (str(int(answer.code)), *(_protocol.written(value, digits) for value in answer.values))
        self._send(_protocol.reply(request.transaction, parts, checked=request.checked))

    def _refuse(self, request: Request, com: Code) -> None:
        self._send(_protocol.reply(request.transaction, ("0",), com=com, checked=request.checked))


def _busy(rpc: int) -> Code | None:
    """What a busy instrument answers, by subsystem; communication and services are never busy."""
    if rpc == 17017:
        return Code.EDM_BUSY
    subsystem = rpc // 1000
    if subsystem in (0, 5):
        return None
    return {2: Code.TMC_BUSY, 6: Code.MOT_BUSY}.get(subsystem, Code.SYSBUSY)
