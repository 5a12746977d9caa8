"""The controller: power, safety and clock of the arm, and the cycle that everything happens in."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from math import radians
from typing import Any, final

from sims.faults import MOVE
from sims.kernel import Event
from sims.simulator import Refused, Request, Setup
from sims.ur._board import Board
from sims.ur._kinematics import AXES, Model, calibrated_rows
from sims.ur._messages import Messages
from sims.ur._modes import JointMode, RobotMode, RuntimeState, SafetyMode
from sims.ur._motion import Limits, Motion
from sims.ur._names import PROGRAM, SPEED
from sims.ur._runtime import Runtime

CYCLES_NS = {"e": 2_000_000, "cb3": 8_000_000}
VERSIONS = {"e": (5, 12, 4, 0), "cb3": (3, 15, 8, 0)}
"""URControl's version: major, minor, bug fix, build."""
POWER_ON_NS = 5_000_000_000
BRAKES_NS = 2_000_000_000
"""From the command to the mode that it leads to."""
BOOT_NS = 20_000_000_000
UNLOCK_NS = 5_000_000_000
"""A protective stop cannot be unlocked earlier."""
HISTORY = 500
"""Cycles of which the joints are known."""
BY_HAND_NS = 300_000_000
"""So long somebody who touches the tip by hand closes the probe's loop."""

CURRENT_NOISE_A = 0.02
"""1 σ of one value."""
FOR_EVER_NS = 1 << 62


@final
class Controller:
    """One arm. `on_cycle`: called at the beginning of each cycle with its number; True: somebody waits for the next."""

    def __init__(self, setup: Setup) -> None:
        cell, kernel, scene = setup.cell, setup.kernel, setup.scene
        self.setup, self.kernel, self.scene = setup, kernel, scene
        self.faults, self.arm = setup.faults, scene.arm
        settings, errors = setup.settings, cell.simulate.errors
        self.series: str = settings["series"]
        self.version = VERSIONS[self.series]
        self.cycle_ns = CYCLES_NS[self.series]
        self.seed = cell.simulate.seed
        self.model = Model(calibrated_rows(cell.robot, self.seed, errors, settings["calibration_knows"]))
        joints = cell.robot.joints
        limits = Limits(
            tuple(radians(joint.min) for joint in joints),
            tuple(radians(joint.max) for joint in joints),
            tuple(radians(joint.max_speed) for joint in joints),
        )
        lag_s = settings["lag_ms"] * 1e-3 * errors["servo"]
        self.motion = Motion(scene.arm, self.model, limits, self.cycle_ns * 1e-9, lag_s, self)
        self.board = Board()
        self.messages = Messages(self.timestamp_us)
        folder = cell.folder / settings["programs"] if settings["programs"] else None
        self.runtime = Runtime(self.motion, self.messages, folder, lambda: self.ready, self._program_began)
        self.mode = RobotMode.RUNNING if settings["power"] == "running" else RobotMode.POWER_OFF
        self.safety = SafetyMode.NORMAL
        self.popup = ""
        self.on_cycle: Callable[[int], bool] = lambda number: False
        self.on_reboot: Callable[[], object] = lambda: None
        self.on_booted: Callable[[], object] = lambda: None
        self.history: list[tuple[float, ...]] = []
        self._remote = settings["control"] == "remote"
        self._booted_ns = kernel.now
        self._by_hand_until_ns = 0
        self._jump_ns = 0
        self._stopped_ns = -UNLOCK_NS
        self._event: Event | None = None
        self._mode_event: Event | None = None
        self._draw = random.Random(f"{self.seed} currents of the UR controller")
        scene.currents.brakes_after_ns = FOR_EVER_NS  # they are held open as long as the power is on
        scene.arm.on_collision = lambda: self.protective_stop(157, 0, "Protective Stop: Collision detected by joint")
        scene.safety.subscribe(self._safety_changed)
        self._subscribe()

    # what is asked of it, and what it tells

    @property
    def ready(self) -> bool:
        """Whether a program can move the arm."""
        return self.mode is RobotMode.RUNNING and self.safety is SafetyMode.NORMAL

    @property
    def remote(self) -> bool:
        """Whether clients may command."""
        return self._remote and not self.faults.active("ur.local")

    @property
    def powered(self) -> bool:
        """Whether the arm has power."""
        return self.mode in (RobotMode.IDLE, RobotMode.RUNNING)

    @property
    def joint_mode(self) -> JointMode:
        """Of all joints."""
        if self.mode is RobotMode.RUNNING:
            return JointMode.RUNNING
        return JointMode.IDLE if self.powered else JointMode.POWER_OFF

    @property
    def serial(self) -> str:
        """Digits; those of another controller by the fault `ur.wrong_serial`."""
        draw = random.Random(f"{self.seed} controller{' another' if self.faults.active('ur.wrong_serial') else ''}")
        return f"2021{draw.randrange(10**7):07d}"

    @property
    def model_name(self) -> str:
        """UR10, by the robot file's name."""
        found = re.search(r"UR\d+", self.setup.cell.robot.name)
        return found[0] if found else "UR10"

    def timestamp(self) -> float:
        """Seconds since the controller has started."""
        return (self.kernel.now - self._booted_ns + self._jump_ns) * 1e-9

    def timestamp_us(self) -> int:
        """The same in microseconds."""
        return (self.kernel.now - self._booted_ns + self._jump_ns) // 1000

    def digital_in(self) -> int:
        """The inputs' bits: the probe's wire, where there is one."""
        number = self.setup.settings["probe_input"]
        closed = self.scene.contact.closed or self.kernel.now < self._by_hand_until_ns
        return int(closed) << number if number is not None else 0

    def currents(self, *, noise: bool = True) -> tuple[float, ...]:
        """Of the joints' motors, A."""
        if self.mode is not RobotMode.RUNNING:
            return (0.0,) * AXES
        true = self.scene.motor_currents()
        return tuple(a + self._draw.gauss(0.0, CURRENT_NOISE_A) for a in true) if noise else true

    def moments(self) -> tuple[float, ...]:
        """That the joints hold the arm, tool and payload with, Nm, without friction."""
        world = self.scene.world
        amperes = world.holding_currents(self.arm.joints())
        return tuple(a * constant for a, constant in zip(amperes, world.motors.nm_per_a, strict=True))

    # power and safety

    def power_on(self) -> None:
        """Switch the arm on: it is idle after a while."""
        if self.mode is RobotMode.POWER_OFF:
            self.mode = RobotMode.BOOTING
            self._later(POWER_ON_NS, RobotMode.IDLE)

    def power_off(self) -> None:
        """Brakes closed, power off."""
        self._cancel()
        self.runtime.stop()
        self.motion.interrupt()
        self.mode = RobotMode.POWER_OFF
        self.wake()

    def release_brakes(self) -> None:
        """From idle to running; switches the arm on where it is off."""
        if self.mode is RobotMode.POWER_OFF:
            self.mode = RobotMode.BOOTING
            self._later(POWER_ON_NS + BRAKES_NS, RobotMode.RUNNING)
        elif self.mode is RobotMode.BOOTING:
            self._later(POWER_ON_NS + BRAKES_NS, RobotMode.RUNNING)
        elif self.mode is RobotMode.IDLE:
            self._later(BRAKES_NS, RobotMode.RUNNING)

    def protective_stop(self, code: int, argument: int, text: str) -> None:
        """Brake; the program waits."""
        if self.safety is not SafetyMode.NORMAL or self.mode is not RobotMode.RUNNING:
            return
        self.safety, self._stopped_ns = SafetyMode.PROTECTIVE_STOP, self.kernel.now
        self.messages.error(code, argument, text)
        self.messages.safety(int(self.safety))
        self.runtime.hold()
        self.wake()

    def unlock(self) -> bool:
        """End a protective stop; False where it is too early. Nothing happens without one."""
        if self.safety is SafetyMode.PROTECTIVE_STOP:
            if self.kernel.now - self._stopped_ns < UNLOCK_NS:
                return False
            self._set_safety(SafetyMode.NORMAL)
        return True

    def restart_safety(self) -> None:
        """After a fault or violation: the arm is then off."""
        if self.safety is SafetyMode.PROTECTIVE_STOP:
            self._set_safety(SafetyMode.NORMAL)
        self.power_off()

    def acknowledge(self) -> None:
        """A person at the pendant ends what can be ended, and switches the arm on. Raises Refused."""
        if not self.scene.safety.ok:
            raise Refused("the safety chain is open")
        self._set_safety(SafetyMode.NORMAL)
        self._cancel()
        self.mode = RobotMode.RUNNING
        self.popup = ""
        self.start_program()

    def start_program(self) -> None:
        """A person starts the cell's program anew; nothing without one, or without power. Raises Refused."""
        program = self.setup.settings["program"]
        if not program or not self.ready or self.runtime.state is RuntimeState.PLAYING:
            return
        self.runtime.stop()
        if self.runtime.loaded != program and not self.runtime.load(program):
            raise Refused(f"there is no program {program}: its script has to be in the folder `programs`")
        if not self.runtime.play():
            raise Refused(f"{program} does not start: {', '.join(self.messages.log[-1:])}")

    def reboot(self) -> None:
        """The controller goes down, and is back after a while with the arm off."""
        self.power_off()
        self.board = Board()
        self.runtime.loaded = ""
        self.motion.set_tool((0.0,) * 6)
        self.motion.slider = 1.0
        self.on_reboot()
        self.kernel.after(BOOT_NS, self._boot)

    @property
    def requests(self) -> dict[str, Request]:
        """On the control port."""
        return {
            "acknowledge": lambda message: self.acknowledge(),
            "by_hand": lambda message: self._by_hand(str(message.get("action"))),
        }

    # the cycle

    def wake(self) -> None:
        """Something is to happen in the next cycle."""
        if self._event is None or not self._event.pending:
            due = -(-(self.kernel.now + 1) // self.cycle_ns) * self.cycle_ns
            self._event = self.kernel.at(due, self._cycle)

    def announce_move(self) -> None:
        """To the schedule of faults."""
        self.faults.announce(MOVE)

    def announce_speed(self) -> None:
        """To the schedule of faults."""
        self.faults.announce(SPEED)

    def _cycle(self) -> None:
        now = self.kernel.now
        self.history.append(self.motion.actual())
        del self.history[:-HISTORY]
        awaited = self.on_cycle(now // self.cycle_ns)
        if self.ready or self.safety is SafetyMode.NORMAL:
            self.runtime.cycle(now)
        stopping = not self.ready
        self.motion.step(now, now + self.cycle_ns, stopping=stopping)
        if awaited or self.motion.moving or self.runtime.active:
            self._event = None
            self.wake()

    def _later(self, after_ns: int, mode: RobotMode) -> None:
        self._cancel()

        def reach() -> None:
            self.mode = mode
            self.wake()

        self._mode_event = self.kernel.after(after_ns, reach)

    def _cancel(self) -> None:
        if self._mode_event:
            self._mode_event.cancel()

    def _set_safety(self, mode: SafetyMode) -> None:
        if mode is not self.safety:
            self.safety = mode
            self.messages.safety(int(mode))

    def _safety_changed(self) -> None:
        """The hard-wired chain, and the PLC's enable, which is wired to the safeguard input."""
        chain = self.scene.safety
        if not chain.emergency_stop_ok:
            self._set_safety(SafetyMode.ROBOT_EMERGENCY_STOP)
            self.power_off()
        elif not (chain.guard_closed and chain.motion_enabled):
            if self.safety in (SafetyMode.NORMAL, SafetyMode.ROBOT_EMERGENCY_STOP):
                self._set_safety(SafetyMode.SAFEGUARD_STOP)
                self.runtime.hold()
        elif self.safety in (SafetyMode.ROBOT_EMERGENCY_STOP, SafetyMode.SAFEGUARD_STOP):
            self._set_safety(SafetyMode.NORMAL)
        self.wake()

    def _by_hand(self, action: str) -> None:
        if action == "start program":
            self.start_program()
            return
        if action == "touch":
            self._by_hand_until_ns = self.kernel.now + BY_HAND_NS
            return
        if action not in ("remote control", "local control"):
            raise Refused("by hand: remote control, local control, start program (pendant), touch (the probe's tip)")
        self._remote = action == "remote control"

    def _boot(self) -> None:
        self._booted_ns, self._jump_ns = self.kernel.now, 0
        self.on_booted()

    def _program_began(self) -> None:
        self.faults.announce(PROGRAM)
        self.wake()

    def _jump(self) -> None:
        fault = self.faults.active("ur.clock_jump")
        self._jump_ns += round((fault.settings["ms"] if fault else 0.0) * 1e6)

    def _subscribe(self) -> None:
        actions: dict[str, Callable[[], Any]] = {
            "ur.protective_stop": lambda: self.protective_stop(153, 0, "Protective Stop: Position deviates from path"),
            "ur.stop": self.runtime.stop,
            "ur.power_off": self.power_off,
            "ur.reboot": self.reboot,
            "ur.clock_jump": self._jump,
        }
        for name, action in actions.items():
            self.faults.on_start(name, action)
