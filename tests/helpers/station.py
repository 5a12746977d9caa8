"""Laser stations for tests: a scripted one on a pseudo terminal, the simulated one on a bench, and cells with one.

`Station` is written from the GeoCOM line syntax alone. Its time is the script's: it moves when the driver sleeps, and
to a request's time-out when the script gives no answer. `Bench` has no robot, reflectors where a test puts them,
requests and replies as text. `write_cell` writes the shipped robot's cell with a laser station, three nests and a
reflector on the flange.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import math
import os
import time
import tty
from collections import defaultdict
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import yaml

from cellctl.clock import Clock
from cellctl.devices import Address, Surroundings
from drivers.geocom_tracker.description import open_tracker
from sims.bench import catalogue
from sims.faults import Faults
from sims.geocom._accuracy import PROFILES
from sims.geocom._instrument import Build
from sims.geocom._server import LaserStation
from tests.helpers.sims import read_fault

NULL, ATMOSPHERE, SET_ATMOSPHERE, MEASURE, FULL, ANGLES = 0, 2029, 2028, 2008, 2167, 2107
TURN, FINE, LOCK_IN, LOCK_STATE, CHANGE_FACE = 9027, 9037, 9013, 6021, 9028
WAKE, TEMPERATURE, POWER, NAME, INCLINED = 111, 5011, 5039, 5004, 2003

MS, S = 1_000_000, 1_000_000_000

TRACKER = "geocom+serial:///dev/ttyUSB0?baud=115200&accuracy=tdra6000"
STATION = {
    "xyz": [3200, -1500, 900],
    "abc": [30, 0, 0],
    "nests": [
        {"id": "N1", "xyz": [1800, 900, 100]},
        {"id": "N2", "xyz": [1500, -1500, 400]},
        {"id": "N3", "xyz": [200, -2200, 700]},
    ],
}
REFLECTORS = {"constant_mm": -3.8, "on_flange": [{"id": "R1", "xyz": [-60, -80, 80], "facing": [-0.6, -0.54, 0.59]}]}


def crc_16_arc(data: bytes) -> int:
    """Straight from its definition: polynomial 0xA001 reflected, start 0."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc


def answer(transaction: int, code: int, *params: object, com: int = 0) -> bytes:
    head, tail = f"%R1P,{com},{transaction}", ":" + ",".join(map(str, (code, *params)))
    return f"{head},{crc_16_arc((head + tail).encode())}{tail}\r\n".encode()


class Counted:
    """The wire of the driver, as a cell in lockstep counts it."""

    def __init__(self) -> None:
        self.written = self.was_read = 0
        self.closed = False

    def wrote(self, count: int) -> None:
        self.written += count

    def read(self, count: int) -> None:
        self.was_read += count

    def close(self) -> None:
        self.closed = True


class ScriptedClock(Clock):
    source = "scripted"

    def __init__(self) -> None:
        self.time_ns = 5_000_000_000
        self.standing_now = 0
        self.counted = Counted()
        self.slept: list[float] = []
        self._timers: list[tuple[int, int, SimpleNamespace]] = []
        self._order = itertools.count()

    def now_ns(self) -> int:
        return self.time_ns

    def call_later(self, seconds: float, callback: Callable[[], object]):
        timer = SimpleNamespace(callback=callback, live=True)
        timer.cancel = lambda: setattr(timer, "live", False)
        heapq.heappush(self._timers, (self.time_ns + round(seconds * 1e9), next(self._order), timer))
        return timer

    def wire(self, device: str) -> Counted:
        self.counted = Counted()
        return self.counted

    @contextmanager
    def standing(self):
        self.standing_now += 1
        try:
            yield
        finally:
            self.standing_now -= 1

    async def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.time_ns += round(seconds * 1e9)
        await asyncio.sleep(0)

    def expire(self) -> None:
        """Let the time-out that is due next pass."""
        while self._timers:
            due, _, timer = heapq.heappop(self._timers)
            if timer.live:
                self.time_ns = max(due, self.time_ns)
                timer.callback()
                return


class Station:
    """Answers requests. `plan[rpc]`: what happens to the next answers to it, in order; then they are all right."""

    def __init__(self) -> None:
        self.clock = ScriptedClock()
        self.plan: dict[int, list[Callable[[int, bytes], None]]] = defaultdict(list)
        self.requests: list[tuple[int, list[str]]] = []
        self.raw: list[bytes] = []
        self.received = self.sent = 0
        self.standing_at_requests: set[int] = set()
        self.codes: dict[int, list[int]] = defaultdict(list)  # return codes to give next
        self.face, self.hz, self.v, self.metres = 1, math.radians(30), math.radians(80), 3.0
        self.collimation, self.index = 0.0, 0.0
        self.lock_states: list[int] = []
        self.lock_state = 1
        self.asleep = False
        self.full_code = 0
        self.name = '"SIM-TDRA6000"'
        self.constant = "0.0"
        self.atmosphere = ["6.58e-07", "1013.25", "12.0", "12.0"]
        self.late: list[bytes] = []
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.path = os.ttyname(self._slave)
        self._got = b""

    # What can happen to an answer.

    def missing(self, _transaction: int, _line: bytes) -> None:
        asyncio.get_running_loop().call_soon(self.clock.expire)

    def comes_late(self, transaction: int, line: bytes) -> None:
        self.late.append(line)
        self.missing(transaction, line)

    def doubled(self, _transaction: int, line: bytes) -> None:
        self.send(line + line)

    def garbled(self, _transaction: int, line: bytes) -> None:
        self.send(b"\x7f" + line[3:9] + b"#\xf0" + line[12:])

    def wrong_check_sum(self, _transaction: int, line: bytes) -> None:
        place = line.index(b":")
        self.send(line[: place - 1] + b"%d" % (9 - int(line[place - 1 : place])) + line[place:])

    def one_wrong_digit(self, _transaction: int, line: bytes) -> None:
        place = line.rindex(b"\r") - 1
        self.send(line[:place] + b"%d" % ((int(line[place : place + 1]) + 1) % 10) + line[place + 1 :])

    def other_transaction(self, transaction: int, _line: bytes) -> None:
        self.send(answer(transaction + 100, 0, 99, 98))
        asyncio.get_running_loop().call_soon(self.clock.expire)

    def without_check_sum(self, transaction: int, _line: bytes) -> None:
        self.send(f"%R1P,0,{transaction}:0,77\r\n".encode())

    def not_heard(self, transaction: int, _line: bytes) -> None:
        self.send(answer(transaction, 0, com=3101))

    # The line.

    def send(self, data: bytes) -> None:
        self.sent += os.write(self._master, data)

    def send_answer(self, transaction: int, code: int, *params: object, com: int = 0) -> None:
        self.send(answer(transaction, code, *params, com=com))

    def hang_up(self) -> None:
        asyncio.get_running_loop().remove_reader(self._master)
        os.close(self._master)
        os.close(self._slave)
        self._master = -1

    def listen(self) -> None:
        asyncio.get_running_loop().add_reader(self._master, self._read)

    def close(self) -> None:
        if self._master >= 0:
            os.close(self._master)
            os.close(self._slave)

    def asked(self) -> list[int]:
        return [rpc for rpc, _ in self.requests]

    def _read(self) -> None:
        data = os.read(self._master, 4096)
        self.received += len(data)
        self.standing_at_requests.add(self.clock.standing_now)
        self._got += data
        *lines, self._got = self._got.split(b"\r\n")
        for line in lines:
            self.raw.append(line)
            if line.strip() and line != b"c":
                self._hear(line.lstrip(b"\n"))

    def _hear(self, line: bytes) -> None:
        head, _, tail = line.partition(b":")
        prefix, rpc, transaction, crc = head.split(b",")
        assert prefix == b"%R1Q"
        assert int(crc) == crc_16_arc(b",".join((prefix, rpc, transaction)) + b":" + tail), line
        self._answer(int(rpc), int(transaction), [part for part in tail.decode().split(",") if part])

    def _answer(self, rpc: int, transaction: int, params: list[str]) -> None:
        for late in self.late:
            self.send(late)
        self.late.clear()
        self.requests.append((rpc, params))
        if self.codes[rpc]:
            line = answer(transaction, self.codes[rpc].pop(0))
        elif self.asleep and rpc != WAKE:
            line = answer(transaction, 0, com=3108)
        else:
            code, *values = self._obey(rpc, params)
            line = answer(transaction, code, *values)
        if self.plan[rpc]:
            self.plan[rpc].pop(0)(transaction, line)
        else:
            self.send(line)

    def _obey(self, rpc: int, params: list[str]) -> tuple[object, ...]:
        match rpc:
            case 5003:
                return 0, 360123
            case 5004:
                return 0, self.name
            case 5034:
                return 0, 4, 20, 0
            case 110:
                return 0, 1, 50, 3
            case 5039:
                return 0, 80, 2, 2
            case 5011:
                return 0, 31.5
            case 2007:
                return 0, 1
            case 17032:
                self.constant = params[1]
            case 17033:
                return 0, self.constant, 1, '"cellctl"'
            case 2029:
                return 0, *self.atmosphere
            case 2028:
                self.atmosphere = params
            case 6021:
                return 0, self.lock_states.pop(0) if self.lock_states else self.lock_state
            case 9027:
                self.face, self.hz, self.v = 1, float(params[0]), float(params[1])
            case 9028:
                self.face = 3 - self.face
            case 111:
                self.asleep = False
            case 2107:
                return 0, *self.reading()
            case 2003:
                return 0, *self.reading(), 1e-6, 0, 0.0, 0.0, 1e-6, 0, self.face - 1
            case 2167:
                return self.full_code, *self.reading(), 2.4e-6, 0.0, 0.0, 1e-6, self.metres, 4711
        return (0,)

    def reading(self) -> tuple[float, float]:
        """What the telescope shows: collimation and index error have the other sign in the other face."""
        if self.face == 1:
            return self.hz + self.collimation, self.v + self.index
        return (self.hz + math.pi - self.collimation) % math.tau, math.tau - self.v + self.index


def tracker_at(station: Station, accuracy: str = "tdra6000"):
    address = Address.parse(f"geocom+serial://{station.path}?baud=115200&accuracy={accuracy}")
    return open_tracker("tracker", address, Surroundings(station.clock, Path()))


@dataclass
class Reflector:
    id: str
    xyz: tuple
    facing: tuple = None
    acceptance_deg: float = 30.0
    constant_mm: float = 0.0

    def __post_init__(self):
        if self.facing is None:  # towards the instrument at the origin
            self.facing = tuple(-part for part in self.xyz)


@dataclass
class Air:
    air_c: float = 12.0
    pressure_hpa: float = 1013.25
    humidity_percent: float = 60.0


@dataclass
class Arm:
    moving: bool = False
    commanded: tuple = (0.0,) * 6
    attempt: int = 0


@dataclass
class World:
    up: tuple = (0.0, 0.0, 1.0)


@dataclass
class Scene:
    """An instrument at the origin of the base frame, upright, with its x along the base's."""

    targets: list = field(default_factory=list)
    frame: np.ndarray = field(default_factory=lambda: np.eye(4))
    air: Air = field(default_factory=Air)
    arm: Arm = field(default_factory=Arm)
    world: World = field(default_factory=World)
    hidden: set = field(default_factory=set)

    def reflectors(self):
        return tuple(self.targets)

    def station(self):
        return self.frame

    def environment(self):
        return self.air

    def blocked(self, start, end):
        return any(one.id in self.hidden and one.xyz == end for one in self.targets)


class Bench:
    """`ask` gives RC and the parameters of a reply; `say` sends bytes; `replies` are the lines, `times` theirs."""

    def __init__(self, kernel, scene, baud=115_200, **build):
        self.kernel, self.scene = kernel, scene
        self.faults = Faults(kernel, catalogue())
        self.replies, self.times = [], []
        kinds = {"seed": 1, "profile": PROFILES["tdra6000"], "noise_scale": 0.0}
        self.station = LaserStation(
            kernel, self.faults, scene, Build(**{**kinds, **build}), baud=baud, reply_ms=4.0, write=self._hear
        )
        self.instrument = self.station.instrument
        self._transaction = 0

    def _hear(self, line):
        assert line.endswith(b"\r\n")
        self.replies.append(line[:-2].decode())
        self.times.append(self.kernel.now)

    def wait(self, ns):
        over = self.kernel.after(ns, lambda: None)
        self._turn(lambda: not over.pending)

    def _turn(self, done):
        """The kernel's own turns, as beside a host that has just been heard."""
        while not done():
            self.kernel._heard_at = time.monotonic_ns()
            self.kernel._lockstep_turn()

    def say(self, text, ns=60 * S):
        """Send, and let so much time pass. Returns the new replies."""
        before = len(self.replies)
        self.station.feed(text.encode("latin-1"))
        self.wait(ns)
        return self.replies[before:]

    def ask(self, rpc, *parameters):
        """One request; the time goes on until its reply and no further."""
        self._transaction += 1
        before = len(self.replies)
        text = ",".join(map(str, parameters))
        self.station.feed(f"%R1Q,{rpc},{self._transaction}:{text}\r\n".encode())
        self._turn(lambda: len(self.replies) > before)
        (reply,) = self.replies[before:]
        head, _, tail = reply.partition(":")
        assert head == f"%R1P,0,{self._transaction}", reply
        code, *values = tail.split(",")
        return int(code), [float(value) if value[0] != '"' else value[1:-1] for value in values]

    def set(self, rpc, *parameters):
        assert self.ask(rpc, *parameters) == (0, [])

    def aim(self, hz, v, half=0.01):
        """Turn there and adjust to the reflector."""
        self.set(18005, 1)
        self.set(9027, hz, v, 0, 0, 0)
        return self.ask(9037, 2 * half, 2 * half, 0)

    def measure(self):
        """A new distance with its angles: code and Hz, V, D."""
        self.set(2008, 3, 1)
        self.set(2008, 1, 1)
        return self.ask(2108, 20_000, 1)

    def fault(self, **entry):
        self.faults.schedule(read_fault(entry))
        self.wait(0)

    def timed(self, *request):
        """How long a request takes, s, with its answer."""
        before = self.kernel.now
        answer = self.ask(*request)
        return (self.kernel.now - before) * 1e-9, answer


def write_cell(root: Path, folder: Path, devices: dict[str, str] | None = None, **simulate: object) -> Path:
    """A cell file in `folder`, with the model of the repository `root`."""
    shipped = root / "procedures/cells/sphere_cell.yaml"
    cell = yaml.safe_load(shipped.read_text())
    cell["model"] = str(shipped.parent / cell["model"])
    cell["devices"] = devices or {"tracker": TRACKER}
    cell["limits"] = {}
    cell["station"], cell["reflectors"], cell["simulate"] = STATION, REFLECTORS, simulate
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(cell))
    return path
