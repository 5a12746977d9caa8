"""The scene of a simulated cell: built before any device's simulator, and given to each of them."""

from __future__ import annotations

from typing import TextIO, final

from sims.cell import SimCell
from sims.faults import Faults
from sims.kernel import Kernel
from sims.memory import Memory
from sims.scene.arm import MovingArm
from sims.scene.contact_log import ContactLog
from sims.scene.contact_loop import ContactLoop
from sims.scene.faults import TIP_JUMP
from sims.scene.measured_places import MeasuredPlaces
from sims.scene.motor_currents import MotorCurrents
from sims.scene.safety import Safety
from sims.scene.stance import Stance, stance_from
from sims.world.environment import Environment
from sims.world.nominal import Matrix
from sims.world.reflectors import Target
from sims.world.screws import Vector
from sims.world.world import World

SAVE_EVERY_NS = 500_000_000


@final
class Scene:
    """The true world, the arm that moves in it, and the contact between its tip and the spheres.

    A robot controller's simulator moves `arm`; a probe's watches `contact`; an instrument's reads the places of the
    tool (`tcp`), of the `reflectors` and of itself (`station`), and what is in the way of its beam (`blocked`);
    `safety` is the hard-wired chain. Each works without the other simulators. The arm is at the position in `memory`,
    else at home. Points are in the robot's base frame, mm. Raises BadMemory.
    """

    def __init__(
        self,
        kernel: Kernel,
        cell: SimCell,
        faults: Faults,
        *,
        truth_log: TextIO | None = None,
        memory: Memory | None = None,
    ) -> None:
        joints = cell.robot.joints
        self._kernel, self._faults, self._memory = kernel, faults, memory or Memory()
        self.world = World(cell, cell.simulate.seed)
        self._memory.recall("ageing", self.world.ageing.recall)
        self.safety = Safety(faults)
        self.contact = ContactLoop()
        self.log = ContactLog(truth_log)
        stance = self._memory.recall("robot", lambda kept: stance_from(kept, len(joints))) or Stance(
            cell.home, cell.home
        )
        speeds = [joint.max_speed for joint in joints]
        self.arm = MovingArm(kernel, self.world, self.contact, self.log, stance, speeds)
        self.currents = MotorCurrents(kernel, self.arm, self.world)
        self._memory.keep("robot", lambda: self.arm.stance().state())
        self._memory.keep("ageing", lambda: self.world.ageing.state(kernel.now))
        self._measured = MeasuredPlaces(cell, self.world.up, faults, self._memory)
        self.contact.subscribe(self._touched)
        faults.on_start(TIP_JUMP.name, self._shorten_tip)
        kernel.after(SAVE_EVERY_NS, self._save_on_the_way)

    def tcp(self, time_ns: int | None = None) -> Vector:
        """The true TCP now, or at another moment of the present motion."""
        return self.arm.tcp(self._kernel.now if time_ns is None else time_ns)

    def reflectors(self, time_ns: int | None = None) -> tuple[Target, ...]:
        """The true reflectors now, or at another moment of the present motion: those on the robot, then the nests'."""
        time_ns = self._kernel.now if time_ns is None else time_ns
        self.world.warm(time_ns)
        return self._measured.reflectors(self.arm.flange(time_ns), self.world.ageing.on_ns(time_ns))

    def station(self, time_ns: int | None = None) -> Matrix:
        """The true frame of the instrument now, or at another time: 4×4, base ← instrument, mm; z: its standing axis.

        Raises LookupError: the cell file has no `station:`.
        """
        time_ns = self._kernel.now if time_ns is None else time_ns
        return self._measured.station(self.world.ageing.on_ns(time_ns))

    @property
    def tilt(self) -> float:
        """Inclination of the instrument's standing axis from the vertical now, degrees. Raises LookupError."""
        return self._measured.tilt(self.world.ageing.on_ns(self._kernel.now))

    def environment(self, time_ns: int | None = None) -> Environment:
        """Temperatures and air now, or at another time."""
        return self.world.environment(self._kernel.now if time_ns is None else time_ns)

    def blocked(self, start: Vector, end: Vector, time_ns: int | None = None) -> bool:
        """Whether a body is between two points, now or at another moment of the present motion.

        Bodies: spheres, their stems and plate, the arm's forearm and wrist, the tool's tube. A reflector on a bracket
        is outside all of them; a point inside a body is blocked.
        """
        links = self.arm.links(self._kernel.now if time_ns is None else time_ns)
        return self.world.blocked(links, start, end)

    def motor_currents(self, time_ns: int | None = None) -> tuple[float, ...]:
        """True mean currents of A1…An, amperes, now or at another moment of the present motion."""
        return self.currents.at(time_ns)

    def _touched(self, closed: bool) -> None:
        """A touch that is over has worn the tip."""
        if not closed:
            self.world.ageing.touched()

    def _shorten_tip(self) -> None:
        fault = self._faults.active(TIP_JUMP.name)
        self.world.ageing.shorten(fault.settings["mm"] if fault else 0.0)
        self.arm.tip_changed()
        self._memory.save()

    def _save_on_the_way(self) -> None:
        """Remember the robot every half second of T while it moves: whoever comes back finds it on its way."""
        if self.arm.moving:
            self._memory.save()
        self._kernel.after(SAVE_EVERY_NS, self._save_on_the_way)
