"""The simulated controller, put together: program, EKI server and RSI client of the scene's arm."""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping
from functools import lru_cache
from math import log
from typing import Any, final
from urllib.parse import parse_qsl, urlsplit

from sims.krc._eki_messages import TableDesk, print_ident
from sims.krc._eki_server import EkiServer
from sims.krc._program import MODES, Program
from sims.krc._rsi_exchange import AxisCorrection, LateCounter, RsiContext, RsiLink, RsiSettings, target_of
from sims.krc._rsi_session import program_of
from sims.krc._servo import LAG_MS, CurrentDisplay, DriveMonitor, Servo
from sims.krc._tables import Tables, state_of_tables, tables_from
from sims.krc._telegram import AXES, BadConfig, EthernetConfig, TelegramFormat, Value, read_config
from sims.scene.arm import MovingArm
from sims.simulator import Refused, Request, Setup, with_settings
from sims.world.world import World

KSS = "V8.6.11"
LONGEST_DELAY = 0.8
"""Of a telegram, in cycles."""


@final
class KrcServers:
    """The controller's ends on the wire. `eki_port`: where its EKI server listens, on 127.0.0.1."""

    def __init__(self, written: str, eki: EkiServer, link: RsiLink, program: Program) -> None:
        self._eki = eki
        self._axes = len(AXES)
        self._program = program
        self._link = link
        self.eki_port = eki.port
        places = {"eki": f"127.0.0.1:{eki.port}"}
        if "controller" in _query(written):
            places["controller"] = "127.0.0.1"
        self.address = with_settings(written, "127.0.0.1:0", **places)
        self.requests: dict[str, Request] = {
            "rsi_target": lambda message: self.set_rsi_target(*target_of(message)),
            "acknowledge": lambda message: self.acknowledge(),
            "own_program": self.take_program,
            "by_hand": lambda message: self.select_mode(str(message.get("action"))),
        }

    def set_rsi_target(self, host: str, port: int) -> None:
        """Where the PC waits for telegrams. Raises OSError where the host is unknown."""
        self._link.set_target(host, port)

    def acknowledge(self) -> None:
        """Acknowledge the message at the pendant. Raises Refused where its cause is still there."""
        if not self._program.acknowledge():
            raise Refused("the controller moves, or its safety chain is open")

    def select_mode(self, mode: str) -> None:
        """Turn the mode selector. Raises Refused for a mode that it does not have."""
        if mode not in MODES:
            raise Refused(f"the mode selector has {', '.join(MODES)}")
        self._program.select_mode(mode)

    def take_program(self, message: dict[str, Any]) -> None:
        """A program of the user's own, to be run by `OWN`. Raises Refused."""
        number, program = program_of(message, self._axes)
        self._program.own_programs[number] = program

    def close(self) -> None:
        """Hang up, and let go of the ports."""
        self._eki.close()
        self._link.close()


def start(setup: Setup, correction: AxisCorrection | None = None) -> KrcServers:
    """Start the controller of the scene's arm. Raises CannotStart, BadMemory.

    `correction`: the RSI context's AXISCORR and its monitor; with none, as the controller has them by default, ± 5° and
    6°, so that the monitor never speaks: AXISCORR clamps before it.
    """
    cell, kernel, memory = setup.cell, setup.kernel, setup.memory
    arm, world = setup.scene.arm, setup.scene.world
    joints = cell.robot.joints
    config = _config(setup)
    settings = rsi_settings(setup.settings, setup.address)
    speeds = [joint.max_speed for joint in joints]
    currents = CurrentDisplay(setup.scene.motor_currents, cell.simulate.seed)
    late = LateCounter(settings.timeout_cycles, settings.counter)
    draw = random.Random(f"{cell.simulate.seed} controller")
    lag = cell.simulate.errors["servo"] if settings.lag_ms is None else settings.lag_ms / LAG_MS
    link = RsiLink(kernel)

    def mark() -> int:
        """Of the session, as the generated program counts them; 0: of a program that gives none."""
        return (link.sessions - 1) % 9999 + 1 if settings.mark == "session" else 0

    context = RsiContext(
        kernel=kernel,
        robot=arm,
        link=link,
        faults=setup.faults,
        config=config,
        telegram=TelegramFormat(config, settings.precision, _values(arm, world, currents, late, mark)),
        settings=settings,
        late=late,
        servo=Servo(speeds, settings.cycle_ms * 1e-3, lag),
        drives=DriveMonitor(speeds, settings.cycle_ms * 1e-3),
        correction=correction or AxisCorrection(relative=settings.mode == "relative"),
        limits=tuple((joint.min, joint.max) for joint in joints),
        # IPOC is the controller's own count since its start: it begins neither at 0 nor at the cell's time
        ipoc_offset_ms=draw.randrange(10_000, 1_000_000_000),
        delay_ns=_delays(settings, cell.simulate.seed),
    )
    serial = f"SIM-{draw.randrange(10**6):06d}"
    ident = print_ident(serial, cell.robot.name, KSS, settings.rsi_on if settings.hello == "rsi_on" else None)
    tables = memory.recall("tables", lambda state: tables_from(state, len(joints))) or Tables()
    program = Program(context, setup.scene.log, ident, TableDesk(tables, serial, memory), memory, setup.scene.safety)
    eki = EkiServer(kernel, program, setup.wire)
    memory.keep("tables", lambda: state_of_tables(tables))

    def restart() -> None:
        """The program and its channel go down."""
        program.restart()
        eki.restart()

    setup.faults.on_start("robot.restart", restart)
    return KrcServers(setup.address, eki, context.link, program)


def rsi_settings(settings: Mapping[str, Any], address: str) -> RsiSettings:
    """Of the `rsi:` section; where it says nothing of the program's mode or cycle, the robot's address does."""
    query = _query(address)
    addressed = {
        "mode": "relative" if query.get("mode") == "relative" else "absolute",
        "cycle_ms": 12 if query.get("cycle") == "ipo" else 4,
    }
    return RsiSettings(**{**settings, **{name: settings[name] or value for name, value in addressed.items()}})


def _delays(settings: RsiSettings, seed: int) -> Callable[[], int]:
    """The delay of each telegram on its way, ns: exponential, and short enough to be answered in its cycle."""
    draw, longest_ms = random.Random(f"{seed} telegram delay"), LONGEST_DELAY * settings.cycle_ms
    mean_ms = settings.jitter_ms / log(2.0)  # of an exponential distribution with this median
    return lambda: round(min(draw.expovariate(1.0 / mean_ms), longest_ms) * 1e6) if mean_ms else 0


def _query(address: str) -> dict[str, str]:
    return dict(parse_qsl(urlsplit(address).query))


def _config(setup: Setup) -> EthernetConfig:
    """The Ethernet configuration that the robot's address names."""
    if len(setup.cell.robot.joints) != len(AXES):
        raise BadConfig(f"this controller drives six axes; the robot file has {len(setup.cell.robot.joints)}")
    named = _query(setup.address).get("ethernet")
    if not named:
        raise BadConfig("its address has no '?ethernet=FILE', the RSI Ethernet configuration")
    return read_config(setup.cell.folder / named)


def _values(
    robot: MovingArm, world: World, currents: CurrentDisplay, late: LateCounter, mark: Callable[[], int]
) -> dict[str, Value]:
    """What each tag shows that is not zero. Under correction only the actual values move: the program stands still."""
    programmed = lru_cache(maxsize=1)(world.shown_pose)
    return {
        "RIst": lambda: world.shown_pose(robot.readings()),
        "RSol": lambda: programmed(robot.commanded),
        "AIPos": robot.readings,
        "ASPos": lambda: robot.commanded,
        "MACur": currents.now,
        "Delay": lambda: (late.count,),
        "Tech.C2": lambda: (mark(), -mark(), *(0.0,) * 8),
    }
