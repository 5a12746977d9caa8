"""A robot controller for tests of its driver, written apart from the driver and from the simulator.

`FaultyLine` is an RSI line with everything that may go wrong on it: a controller that holds set-points as RSI does, the
driver's responder, and between them delays, losses both ways, duplicates, foreign senders and counts that are off.
`ControllerTables` are written by hand from docs/reference/eki-channel.md: what a driver's pushes meet. `CutLine` is the
controller's end of the transfer channel with tables behind it, which may hang up at any byte. `wavy_model` makes
correction models for tests of the process that applies them.
"""

from __future__ import annotations

import asyncio
import math
import os
import re
import zlib
from abc import abstractmethod
from collections import deque
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule

from cellctl.clock import WallClock
from drivers.kuka_rsi.cyclic.responder import ControllerLine, Responder
from drivers.kuka_rsi.cyclic.session import CyclicTask, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock, Slot
from drivers.kuka_rsi.cyclic.telegram import ReplyFormat
from drivers.kuka_rsi.eki.channel import EkiChannel
from drivers.kuka_rsi.eki.tables import TableChannel

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
TIMEOUT = 100
CONTROLLER = "192.168.10.1"
ROUNDING = 3e-6
SERVO_S = 0.024
TEMPLATE = '<Sen><AK A="{0:.6f} {1:.6f} {2:.6f} {3:.6f} {4:.6f} {5:.6f}"/><Stop>{6:d}</Stop><IPOC>{7}</IPOC></Sen>'

Row = tuple[str, ...]
"""A row as it came: number, six nominal, six compensated, each as text."""

COMMAND = re.compile(rb'<Cmd Id="(\d+)" Op="(\w+)">(.*?)</Cmd>', re.DOTALL)
NEVER = 1 << 30

AXES = 6
LINKS = ((675.0, 350.0, -90.0), (0.0, 1150.0, 0.0), (0.0, 41.0, 90.0), (1000.0, 0.0, 90.0), (0.0, 0.0, 90.0))
"""d, a, alpha of a heavy robot, joint by joint; the flange lies 240 mm along the last axis."""
Matrix = list[list[float]]


@dataclass(frozen=True)
class Weather:
    """What happens to one cycle's telegram and answer; delays, and what the count is off by, in cycles."""

    telegram_lost: bool = False
    telegram_late: int = 0
    twice: bool = False
    answer_lost: bool = False
    answer_late: int = 0
    foreign: bool = False
    asleep: bool = False
    count_off: int = 0


FAULTS = [
    Weather(telegram_lost=True),
    Weather(telegram_late=1),
    Weather(telegram_late=3),
    Weather(twice=True),
    Weather(answer_lost=True),
    Weather(answer_late=1),
    Weather(telegram_late=1, twice=True, answer_late=1),
    Weather(foreign=True),
    Weather(asleep=True),
    *(Weather(count_off=by) for by in (-25_000, -1, 1, 8)),
]
CALM = st.sampled_from([0, 1, 2, 5, 60])
RESTARTS = st.sampled_from([3, 4, 5, 9, 40, 98, 101, 1000])
"""Cycles from a session's last answer to the first telegram of the next one: after three or more it shows."""


@dataclass
class Krc:
    """RSI from RSI_ON on: what it sends, what it holds. `counts`: how its Delay behaves, `total`, `reset` or `none`."""

    relative: bool
    cycle_ms: int
    counts: str
    precision: int
    ipoc: int
    port: int = 30_000
    late: int = 0
    unanswered: int = 0
    on: bool = True
    outputs: tuple[float, ...] = (0.0,) * 6
    offset: tuple[float, ...] = (0.0,) * 6
    joints: tuple[float, ...] = HOME
    zero: tuple[float, ...] = HOME
    answer: tuple[float, ...] | None = None

    def hear(self, reply: bytes) -> None:
        ipoc = int(re.search(rb"<IPOC>(\d+)<", reply)[1])
        if self.on and ipoc == self.ipoc:
            self.answer = tuple(map(float, re.search(rb'A="([^"]*)"', reply)[1].split()))

    def cycle(self) -> bool:
        """Take the answer that came, or do without, and go on by a cycle. Whether one was taken."""
        taken = self.answer is not None
        if taken:
            self.outputs, self.unanswered = self.answer, 0
            self.late = 0 if self.counts == "reset" else self.late
        else:
            self.late, self.unanswered = self.late + 1, self.unanswered + 1
            self.outputs = (0.0,) * 6 if self.relative else self.outputs
        self.offset = plus(self.offset, self.outputs) if self.relative else self.outputs
        share = 1 - math.exp(-self.cycle_ms / 1000 / SERVO_S)
        target = plus(self.zero, self.offset)
        self.joints = tuple(a + share * (b - a) for a, b in zip(self.joints, target, strict=True))
        self.answer = None
        self.ipoc += self.cycle_ms
        self.on = self.unanswered <= TIMEOUT
        return taken

    def telegram(self, ipoc: int | None = None) -> bytes:
        axes = " ".join(f'A{i}="{value:.{self.precision}f}"' for i, value in enumerate(self.joints, 1))
        delay = "" if self.counts == "none" else f'<Delay D="{self.late}"/>'
        return f"<Rob><AIPos {axes}/>{delay}<IPOC>{ipoc or self.ipoc}</IPOC></Rob>".encode()

    def switch_on(self) -> None:
        """A new session: its output begins at zero, its zero is where the robot is."""
        self.on, self.late, self.unanswered, self.answer = True, 0, 0, None
        self.outputs = self.offset = (0.0,) * 6
        self.zero = self.joints


def plus(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(x + y for x, y in zip(a, b, strict=True))


@dataclass
class Wire:
    """Stands in for the socket: datagrams under way in both directions, with the cycle in which they arrive."""

    inbox: deque[tuple[bytes, tuple[str, int]]] = field(default_factory=deque)
    replies: list[bytes] = field(default_factory=list)

    def recvfrom(self, size: int) -> tuple[bytes, tuple[str, int]]:
        if not self.inbox:
            raise BlockingIOError
        return self.inbox.popleft()

    def sendto(self, reply: bytes, place: tuple[str, int]) -> None:
        assert place[0] == CONTROLLER
        self.replies.append(reply)

    def setsockopt(self, *_: object) -> None:
        raise OSError("no filter here")


class FaultyLine(RuleBasedStateMachine):
    """The driver's responder and the controller, cycle by cycle; `check` looks at each cycle."""

    def connect(self, krc: Krc, task_of: Callable[[SearchOrder], CyclicTask]) -> None:
        """The responder answers `krc` by the task of each order."""
        self.krc, self.wire = krc, Wire()
        self.block, fd = SharedBlock.create()
        os.close(fd)
        self.now_ns = self.time = self.number = 0
        line = ControllerLine(self.wire, CONTROLLER)
        self.responder = Responder(line, self.block, ReplyFormat(TEMPLATE), lambda: self.now_ns, task_of)
        self.under_way: list[tuple[int, bytes, tuple[str, int]]] = []
        self.answers_under_way: list[tuple[int, bytes]] = []

    @abstractmethod
    def check(self, step_before: tuple[float, ...]) -> None:
        """What the controller holds, `self.krc.offset`, went on by `self.step` in this cycle; asserts its limits."""

    def cycle(self, weather: Weather) -> None:
        before, step_before, krc = self.krc.offset, self.step, self.krc
        self.time += 1
        self.now_ns += krc.cycle_ms * 1_000_000
        self.calm = self.calm + 1 if krc.cycle() else 0
        self.step = tuple(a - b for a, b in zip(krc.offset, before, strict=True))
        self.check(step_before)
        if krc.on:
            self.send(krc.telegram(krc.ipoc + weather.count_off * krc.cycle_ms), weather)
        if weather.foreign:
            for place in (("10.0.0.9", 30_000), (CONTROLLER, 9)):
                self.wire.inbox.append((krc.telegram(krc.ipoc + 400), place))
        self.carry(weather)

    def send(self, telegram: bytes, weather: Weather) -> None:
        place = (CONTROLLER, self.krc.port)
        for _ in range(0 if weather.telegram_lost else 1 + weather.twice):
            self.under_way.append((self.time + weather.telegram_late, telegram, place))

    def carry(self, weather: Weather) -> None:
        due = [one for one in self.under_way if one[0] <= self.time]
        self.under_way = [one for one in self.under_way if one[0] > self.time]
        self.wire.inbox.extend((telegram, place) for _, telegram, place in due)
        if not weather.asleep:
            self.responder.answer()
        if not weather.answer_lost:
            self.answers_under_way += [(self.time + weather.answer_late, reply) for reply in self.wire.replies]
        self.wire.replies.clear()
        for one in [one for one in self.answers_under_way if one[0] <= self.time]:
            self.answers_under_way.remove(one)
            self.krc.hear(one[1])

    def spell(self, cycles: int, weather: Weather) -> None:
        for _ in range(cycles):
            self.cycle(weather)

    def end_session(self) -> None:
        """The last order is over; RSI is switched on anew for the next number."""
        self.block.release()
        self.responder.answer()
        self.switch_on(500)
        self.number += 1
        self.block.words[Slot.STOP] = 0

    def switch_on(self, after_ms: int, *, new_port: bool = False) -> None:
        self.time += after_ms // self.krc.cycle_ms
        self.now_ns += after_ms * 1_000_000
        self.krc.ipoc += after_ms
        self.krc.port += new_port
        self.krc.switch_on()
        self.step, self.calm = (0.0,) * 6, 0

    @abstractmethod
    def next_session(self) -> None:
        """RSI is switched on anew, and the next order answers it."""

    @rule(after=RESTARTS, asleep=st.sampled_from([0, 1, 40]), then=CALM)
    def rsi_restarts(self, after: int, asleep: int, then: int) -> None:
        """By the same port, the count goes on; the PC sleeps before and after. Nobody announces it to the driver.

        The last answer was taken: a lost one, or a count that is off, would make it the restart after a cycle or two
        that no telegram shows.
        """
        self.spell(2, Weather())
        self.spell(min(asleep, after - 1), Weather(asleep=True))
        self.switch_on(max(1, after - asleep) * self.krc.cycle_ms)
        self.spell(asleep, Weather(asleep=True))
        self.spell(then + 5, Weather())
        assert not any(self.krc.offset)
        self.next_session()

    @rule(fault=st.sampled_from(FAULTS), cycles=st.sampled_from([1, 1, 1, 2, 5]), then=CALM)
    def one_fault(self, fault: Weather, cycles: int, then: int) -> None:
        self.spell(cycles, fault)
        self.spell(then, Weather())

    @rule(cycles=st.sampled_from([30, 60, 90]), asleep=st.booleans(), then=CALM)
    def an_outage(self, cycles: int, asleep: bool, then: int) -> None:
        """Within the tolerance, if it is not the second in a row."""
        self.spell(cycles, Weather(asleep=True) if asleep else Weather(answer_lost=True))
        self.spell(then, Weather())


@dataclass
class Kept:
    """A table on the controller: `rows` it is to have, `sum` announced, `lines` arrived."""

    id: str
    rows: int
    sum: str
    lines: list[Row] = field(default_factory=list)


@dataclass
class ControllerTables:
    """Takes the table commands and answers as the reference says; `tampered` spoils what is read back."""

    serial: str = "SIM-000007"
    active: Kept | None = None
    previous: Kept | None = None
    staged: Kept | None = None
    operations: list[str] = field(default_factory=list)
    tampered: dict[str, str] = field(default_factory=dict)
    forgets_before: str = ""
    blocks: list[int] = field(default_factory=list)

    def answer(self, operation: str, document: str) -> tuple[int, str]:
        """Code and further content of the reply."""
        self.operations.append(operation)
        if operation == self.forgets_before:
            self.staged = None
        handler = getattr(self, f"_{operation.lower()}")
        return handler(document)

    def _tstage(self, document: str) -> tuple[int, str]:
        head = _attributes(document, "Table")
        if head["Serial"] != self.serial:
            return 40, ""
        if not 0 < int(head["Rows"]) <= 500:
            return 43, ""
        self.staged = Kept(head["Id"], int(head["Rows"]), head["Sum"])
        return 0, ""

    def _tblock(self, document: str) -> tuple[int, str]:
        if self.staged is None:
            return 42, ""
        head, rows = _attributes(document, "Block"), _rows(document)
        self.blocks.append(len(rows))
        if int(head["First"]) != len(self.staged.lines) + 1 or not 0 < len(rows) == int(head["Count"]) <= 10:
            return 42, ""
        if _sum(rows) != head["Sum"]:
            return 41, ""
        self.staged.lines += rows
        return 0, ""

    def _tread(self, document: str) -> tuple[int, str]:
        table = self.staged or self.active
        if table is None:
            return 42, ""
        head = _attributes(document, "Block")
        first, count = int(head["First"]), int(head["Count"])
        rows = table.lines[first - 1 : first - 1 + count]
        text = f'<Block First="{first}" Count="{len(rows)}" Sum="{_sum(rows)}"/>' + "".join(map(_element, rows))
        for old, new in self.tampered.items():
            text = text.replace(old, new)
        return 0, text

    def _tactivate(self, document: str) -> tuple[int, str]:
        asked = _attributes(document, "Table")
        if self.staged is None:
            return (0 if self.active and self.active.id == asked["Id"] else 42), ""
        if len(self.staged.lines) != self.staged.rows:
            return 42, ""
        if asked["Id"] != self.staged.id or not asked["Sum"] == self.staged.sum == _sum(self.staged.lines):
            return 41, ""
        self.active, self.previous, self.staged = self.staged, self.active, None
        return 0, ""

    def _trollback(self, _: str) -> tuple[int, str]:
        if self.active is None and self.previous is None:
            return 42, ""
        self.active, self.previous = self.previous, self.active
        return 0, ""

    def _tstate(self, _: str) -> tuple[int, str]:
        kept = {"Active": self.active, "Previous": self.previous}
        text = "".join(
            f'<{tag} Id="{table.id}" Rows="{table.rows}" Sum="{_sum(table.lines)}"/>'
            for tag, table in kept.items()
            if table
        )
        if self.staged:
            text += f'<Staged Id="{self.staged.id}" Rows="{self.staged.rows}" Taken="{len(self.staged.lines)}"/>'
        return 0, text


def _attributes(document: str, tag: str) -> dict[str, str]:
    found = re.search(rf"<{tag} ([^>]*)/>", document)
    assert found, f"no <{tag}> in {document}"
    return dict(re.findall(r'(\w+)="([^"]*)"', found[1]))


def _rows(document: str) -> list[Row]:
    return [
        (number, *re.findall(r'A[1-6]="([^"]*)"', body))
        for number, body in re.findall(r'<R N="(\d+)">(.*?)</R>', document)
    ]


def _sum(rows: list[Row]) -> str:
    text = "".join(";".join(row) + "\n" for row in rows)
    return f"{zlib.crc32(text.encode()):08X}"


def _element(row: Row) -> str:
    def joints(tag: str, values: Row) -> str:
        return f"<{tag} " + " ".join(f'A{i}="{value}"' for i, value in enumerate(values, 1)) + "/>"

    return f'<R N="{row[0]}">{joints("Q", row[1:7])}{joints("C", row[7:])}</R>'


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


def wavy_model(size: float, fade_deg: float = 2.0, span_deg: float = 120.0) -> dict[str, list[float]]:
    """A robot with errors of links, weight, gears and field; size 1: some millimetres. Measured from −span to span."""
    links = [_step(*link) for link in LINKS]
    errors = [(0.3 * size, 0.4 * size, 0.03 * size), (0.0, -0.5 * size, 0.02 * size), *[(0.1 * size,) * 3] * 3]
    true = [_step(d + x, a + y, alpha + z / 3) for (d, a, alpha), (x, y, z) in zip(LINKS, errors, strict=True)]
    flange = _step(240.0, 0.0, 0.0)
    identity = _step(0.0, 0.0, 0.0)
    node = [0.1 * j - 0.2 for j in range(AXES)]
    return {
        "sign": [1.0] * AXES,
        "offset": [0.0] * AXES,
        "base": _flat(identity),
        "links": _all([identity, *links, flange]),
        "tool": _flat(_step(300.0, -200.0, 0.0)),
        "identified": _all([identity, *true, _step(540.0, -200.0 + 0.2 * size, 0.0)]),
        "identified_base": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "down": [0.0, 0.0, -1.0],
        "weight": [2e-4 * size] * (2 * AXES * AXES),
        "load": [1e-6 * size] * AXES,
        "load_place": [-50.0, 0.0, 200.0],
        "bend": [0.1 * size],
        "stretch": [0.0] * (AXES + 1),
        "wave_joint": [0.0, 1.0, 2.0],
        "wave_order": [1.0, 2.0, 17.0],
        "wave_sine": [2e-4 * size] * 3,
        "wave_cosine": [1e-4 * size] * 3,
        "node_place": node,
        "node_scale": [1.0] * AXES,
        "node_weight": [0.3 * size, -0.2 * size, 0.1 * size],
        "lower": [-span_deg] * AXES,
        "upper": [span_deg] * AXES,
        "fade": [fade_deg],
    }


def _step(d: float, a: float, alpha_deg: float) -> Matrix:
    """Tz(d) Tx(a) Rx(alpha)."""
    c, s = math.cos(math.radians(alpha_deg)), math.sin(math.radians(alpha_deg))
    return [[1.0, 0.0, 0.0, a], [0.0, c, -s, 0.0], [0.0, s, c, d], [0.0, 0.0, 0.0, 1.0]]


def _flat(matrix: Matrix) -> list[float]:
    return [value for row in matrix for value in row]


def _all(matrices: list[Matrix]) -> list[float]:
    return [value for matrix in matrices for value in _flat(matrix)]
