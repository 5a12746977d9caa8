"""The laser station on a bench: no robot, reflectors where a test puts them, requests and replies as text."""

import time
from dataclasses import dataclass, field

import numpy as np

from sims.faults import Faults
from sims.geocom._accuracy import PROFILES
from sims.geocom._instrument import Build
from sims.geocom._server import LaserStation
from tests.helpers.simulated_devices import catalogue, read_fault

MS, S = 1_000_000, 1_000_000_000


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
