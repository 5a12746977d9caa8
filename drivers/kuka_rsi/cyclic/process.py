"""The process that answers the controller in each cycle: `python -m drivers.kuka_rsi.cyclic.process SETTINGS`.

It imports nothing from the engine, has its garbage collector off, and runs in real time as far as permitted. It holds
the robot and exits when its parent has ended. SETTINGS is JSON (`ProcessSettings`); one line of JSON on stdout reports
its address, or why it cannot listen.
"""

from __future__ import annotations

import ctypes
import json
import os
import select
import signal
import sys
import time
from dataclasses import asdict, dataclass
from typing import Self, final

from cellctl.clock import reader_of
from drivers.kuka_rsi.cyclic.limits import OnlineLimits, SearchLimits
from drivers.kuka_rsi.cyclic.online_block import OnlineSlot
from drivers.kuka_rsi.cyclic.online_correction import OnlineCorrection
from drivers.kuka_rsi.cyclic.real_time import become_real_time
from drivers.kuka_rsi.cyclic.responder import ControllerLine, Responder
from drivers.kuka_rsi.cyclic.search_cycle import SearchCycle
from drivers.kuka_rsi.cyclic.session import CyclicTask, InterpolationCycle, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock
from drivers.kuka_rsi.cyclic.telegram import CorrectionMode, ReplyFormat

_LOOK_S = 0.05
"""Longest wait for a telegram before orders and the parent are checked."""

_SOON_S = 0.001
"""The same while a telegram of this cycle waits for its session's start."""

_LEAVE_S = 3.0
"""Longest delay of the exit by a search that is being held, or an on-line correction that fades.

A correction of 2 deg at 0.5 deg/s needs 4 s: the rest is held by the controller, which stops after its `Timeout`.
"""

_PR_SET_PDEATHSIG = 1
"""linux/prctl.h: the signal that a process gets when its parent ends."""


@final
@dataclass(frozen=True, slots=True)
class ProcessSettings:
    """The process's settings from its command line.

    `host`, `port`: to bind; `controller`: the accepted host; `tolerance`: cycles without an answer after which a
    session is over; `memory`: inherited descriptor of the shared block; `clock`: source of the cell's time; `reply`:
    template of the reply; `mode`: of the corrections; `cycle`: of the controller; `limits`: as in `SearchLimits`;
    `online`: as in `OnlineLimits`; `parent`: process ends with it.
    """

    host: str
    port: int
    controller: str
    tolerance: int
    memory: int
    clock: str
    reply: str
    mode: CorrectionMode
    cycle: InterpolationCycle
    limits: dict[str, float]
    online: dict[str, float]
    parent: int

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `to_json` wrote."""
        values = json.loads(text)
        enums = {"mode": CorrectionMode(values["mode"]), "cycle": InterpolationCycle(values["cycle"])}
        return cls(**values | enums)

    def to_json(self) -> str:
        """One line of JSON."""
        return json.dumps(asdict(self))


class _Leaving:
    """Whether to exit: on request, or because the parent ended."""

    def __init__(self, parent: int) -> None:
        self._parent = parent
        self._asked = False
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the engine handles Ctrl-C: it holds the robot first
        signal.signal(signal.SIGTERM, self._ask)
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)

    def __bool__(self) -> bool:
        # the parent's number too: the signal does not come if the parent ended before prctl was called
        return self._asked or os.getppid() != self._parent

    def _ask(self, *_: object) -> None:
        self._asked = True


def run(settings: ProcessSettings) -> int:
    """Bind, report the address, and answer until told to exit; returns the exit code."""
    leaving = _Leaving(settings.parent)
    try:
        line = ControllerLine.bind(settings.host, settings.port, settings.controller)
    except OSError as error:
        _report({"errno": error.errno, "error": error.strerror})
        return 1
    block = SharedBlock(settings.memory)
    os.close(settings.memory)
    reply, limits, clock = ReplyFormat(settings.reply), SearchLimits(**settings.limits), reader_of(settings.clock)

    online = OnlineLimits(**settings.online)

    def task_of(order: SearchOrder) -> CyclicTask:
        if block.online.words[OnlineSlot.ORDER] == order.number:
            return OnlineCorrection(order, online, block.online, settings.tolerance, settings.cycle)
        return SearchCycle(order, limits, settings.mode, settings.tolerance, settings.cycle)

    responder = Responder(line, block, reply, clock, task_of)
    _report({"listening": line.place, **become_real_time()})
    _serve(line, responder, leaving)
    return 0


def _serve(line: ControllerLine, responder: Responder, leaving: _Leaving) -> None:
    give_up: float | None = None
    while True:
        look_s = _SOON_S if responder.waits_for_announcement else _LOOK_S
        ready, _, _ = select.select([line], [], [], look_s)
        go = bool(leaving)
        responder.answer(leave=go)
        if go:
            give_up = give_up or time.monotonic() + _LEAVE_S  # wall time: the cell's may stand, its engine is gone
            # no telegram for `_LOOK_S` (four cycles of 12 ms): RSI is off, there is nothing to hold
            if not ready or not responder.busy or time.monotonic() > give_up:
                return


def _report(what: dict[str, object]) -> None:
    print(json.dumps(what), flush=True)


if __name__ == "__main__":
    sys.exit(run(ProcessSettings.from_json(sys.argv[1])))
