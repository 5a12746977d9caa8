"""The simulated controller, put together: arm, program, EKI server, RSI client."""

from __future__ import annotations

import random
from typing import TextIO, final
from urllib.parse import parse_qs, urlsplit

from sims.cell import SimCell
from sims.faults import Faults
from sims.kernel import Kernel
from sims.krc.currents import MotorCurrents
from sims.krc.drive_monitor import DriveMonitor
from sims.krc.eki_messages import print_ident
from sims.krc.eki_server import EkiServer
from sims.krc.ethernet_config import BadConfig, EthernetConfig, read_config
from sims.krc.program import Program
from sims.krc.rsi_link import RsiLink
from sims.krc.rsi_session import RsiContext
from sims.krc.servo import Servo
from sims.krc.signal_flow import AxisCorrection, LateCounter
from sims.krc.table_desk import TableDesk
from sims.krc.table_memory import tables_of, told_tables
from sims.krc.tables import Tables
from sims.krc.telegram import TelegramFormat, Value
from sims.memory import Memory
from sims.scene.arm import MovingArm
from sims.scene.contact_log import ContactLog
from sims.scene.contact_loop import ContactLoop
from sims.scene.stance import Stance, stance_of
from sims.wires import Wire
from sims.world.world import World

SCHEME = "kuka+rsi"
KSS = "V8.6.11"
START = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
SAVE_EVERY_NS = 500_000_000


@final
class KrcServers:
    """The controller's ends on the wire. `eki_port`: where its EKI server listens, on 127.0.0.1."""

    def __init__(self, eki: EkiServer, link: RsiLink) -> None:
        self._eki = eki
        self._link = link
        self.eki_port = eki.port

    def set_rsi_target(self, host: str, port: int) -> None:
        """Where the PC waits for telegrams. Raises OSError where the host is unknown."""
        self._link.set_target(host, port)

    def close(self) -> None:
        """Hang up, and let go of the ports."""
        self._eki.close()
        self._link.close()


def start(
    kernel: Kernel,
    cell: SimCell,
    faults: Faults,
    loop: ContactLoop,
    truth_log: TextIO | None,
    correction: AxisCorrection | None = None,
    memory: Memory | None = None,
    wire: Wire | None = None,
) -> KrcServers:
    """Start the controller of the cell's robot, which stands bent and clear, or as `memory` has it. Raises
    BadConfig, BadMemory.

    `correction`: the RSI context's AXISCORR and its monitor; with none, as the controller has them by default, ± 5° and
    6°, so that the monitor never speaks: AXISCORR clamps before it. `wire`: where its EKI server counts its bytes.
    """
    config = _config(cell)
    settings, joints = cell.simulate.rsi, cell.robot.joints
    speeds = [joint.max_speed for joint in joints]
    memory = memory or Memory()
    world = World(cell, cell.simulate.seed)
    memory.recall("ageing", world.ageing.recall)
    log = ContactLog(truth_log)
    stance = memory.recall("robot", lambda told: stance_of(told, len(joints))) or _first_stance(cell)
    robot = MovingArm(kernel, world, loop, log, stance, speeds)
    currents = MotorCurrents(kernel, robot, world, cell.robot.tool.mass)
    late = LateCounter(settings.timeout_cycles, settings.counter)
    draw = random.Random(f"{cell.simulate.seed} controller")
    context = RsiContext(
        kernel=kernel,
        robot=robot,
        link=RsiLink(kernel),
        faults=faults,
        config=config,
        telegram=TelegramFormat(config, settings.precision, _values(robot, world, currents, late)),
        settings=settings,
        late=late,
        servo=Servo(speeds, settings.cycle_ms * 1e-3, cell.simulate.errors["servo"]),
        drives=DriveMonitor(speeds, settings.cycle_ms * 1e-3),
        correction=correction or AxisCorrection(relative=settings.mode == "relative"),
        limits=tuple((joint.min, joint.max) for joint in joints),
        ipoc_offset_ms=draw.randrange(10_000, 1_000_000_000),
    )
    serial = f"SIM-{draw.randrange(10**6):06d}"
    ident = print_ident(serial, cell.robot.name, KSS)
    tables = memory.recall("tables", lambda told: tables_of(told, len(joints))) or Tables()
    program = Program(context, log, ident, TableDesk(tables, serial, memory), memory)
    eki = EkiServer(kernel, program, wire or Wire())
    memory.keep("robot", lambda: robot.stance().told())
    memory.keep("ageing", lambda: world.ageing.told(kernel.now))
    memory.keep("tables", lambda: told_tables(tables))
    _save_on_the_way(kernel, robot, memory)
    _subscribe(faults, loop, world, robot, program, eki, memory)
    return KrcServers(eki, context.link)


def _save_on_the_way(kernel: Kernel, robot: MovingArm, memory: Memory) -> None:
    """Remember the robot every half second of T while it moves: whoever comes back finds it on its way."""

    def save() -> None:
        if robot.moving:
            memory.save()
        kernel.after(SAVE_EVERY_NS, save)

    kernel.after(SAVE_EVERY_NS, save)


def _subscribe(
    faults: Faults, loop: ContactLoop, world: World, robot: MovingArm, program: Program, eki: EkiServer, memory: Memory
) -> None:
    """A touch that is over has worn the tip; a jump shortens it; a restart takes the program and its channel down."""

    def touched(closed: bool) -> None:
        if not closed:
            world.ageing.touched()

    def jump() -> None:
        fault = faults.active("tip.jump")
        world.ageing.shorten(fault.mm if fault else 0.0)
        robot.tip_changed()
        memory.save()

    def restart() -> None:
        program.restart()
        eki.restart()

    loop.subscribe(touched)
    faults.on_start("tip.jump", jump)
    faults.on_start("robot.restart", restart)


def _first_stance(cell: SimCell) -> Stance:
    """Bent and clear, as far as the axes' limits let it."""
    joints = tuple(min(max(angle, axis.min), axis.max) for angle, axis in zip(START, cell.robot.joints, strict=True))
    return Stance(joints, joints)


def _config(cell: SimCell) -> EthernetConfig:
    """The Ethernet configuration that the robot's address names."""
    if len(cell.robot.joints) != len(START):
        raise BadConfig(f"this controller drives six axes; the robot file has {len(cell.robot.joints)}")
    address = next((text for text in cell.addresses.values() if urlsplit(text).scheme == SCHEME), None)
    named = parse_qs(urlsplit(address or "").query).get("ethernet")
    if not named:
        raise BadConfig(f"{cell.name}: no {SCHEME}:// address with '?ethernet=FILE', the RSI Ethernet configuration")
    return read_config(cell.folder / named[0])


def _values(robot: MovingArm, world: World, currents: MotorCurrents, late: LateCounter) -> dict[str, Value]:
    """What each tag shows that is not zero. Under correction only the actual values move: the program stands still."""
    return {
        "RIst": lambda: world.shown_pose(robot.readings()),
        "RSol": lambda: world.shown_pose(robot.commanded),
        "AIPos": robot.readings,
        "ASPos": lambda: robot.commanded,
        "MACur": currents.now,
        "Delay": lambda: (late.count,),
    }
