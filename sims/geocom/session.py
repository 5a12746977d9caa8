"""One request after another: read, done, answered. GeoCOM is strictly synchronous."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import final

from sims.faults import Faults
from sims.geocom import lines
from sims.geocom.codes import Code
from sims.geocom.instrument import Instrument, Power
from sims.geocom.lines import LONGEST, Request, WrongChecksum, WrongFormat
from sims.geocom.procedures import Procedures
from sims.geocom.work import Answer, Step, Work
from sims.kernel import Event, Kernel

WAKE_UP = 111
ABORTED = b"?" + lines.TERMINATOR


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
        self._send(lines.reply(0, ("0",), com=Code.COM_OVERRUN))

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
            request = lines.parse_request(line)
        except WrongFormat:
            self._send(lines.reply(0, ("0",), com=Code.COM_WRONG_FORMAT))
        except WrongChecksum:
            self._send(lines.reply(0, ("0",), com=Code.COM_SRVR_RX_CHECKSUM_ERR, checked=True))
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
        parts = (str(int(answer.code)), *(lines.written(value, digits) for value in answer.values))
        self._send(lines.reply(request.transaction, parts, checked=request.checked))

    def _refuse(self, request: Request, com: Code) -> None:
        self._send(lines.reply(request.transaction, ("0",), com=com, checked=request.checked))


def _busy(rpc: int) -> Code | None:
    """What a busy instrument answers, by subsystem; communication and services are never busy."""
    if rpc == 17017:
        return Code.EDM_BUSY
    subsystem = rpc // 1000
    if subsystem in (0, 5):
        return None
    return {2: Code.TMC_BUSY, 6: Code.MOT_BUSY}.get(subsystem, Code.SYSBUSY)
