"""The scene of a simulated cell, given to each device's simulator: arm, motor currents, places that are measured."""

from __future__ import annotations

from collections.abc import Mapping
from math import dist
from typing import Any, TextIO, final

from sims.cell_content import Reflectors, SimCell
from sims.faults import Faults
from sims.kernel import Kernel
from sims.memory import Memory
from sims.scene.arm import MovingArm, Stance, stance_from
from sims.scene.contact import ContactLog, ContactLoop
from sims.scene.motions import Joints
from sims.scene.safety import REFLECTOR_WRONG, STATION_BUMP, TIP_JUMP, Safety
from sims.world.environment import Environment
from sims.world.kinematics import Matrix, Vector, vector
from sims.world.true_places import Target, TrueReflectors, TrueStation, true_nests
from sims.world.world import World


@final
class MeasuredPlaces:
    """Of one cell. Times are `on_ns`: how long the cell has been on. Bumps of the station are kept in `memory`."""

    def __init__(self, cell: SimCell, up: Vector, faults: Faults, memory: Memory) -> None:
        seed, errors = cell.simulate.seed, cell.simulate.errors
        self._faults, self._memory = faults, memory
        self._bumps: list[tuple[float, float]] = memory.recall("station", _bumps) or []
        self._file = cell.reflectors or Reflectors()
        self._on_robot = TrueReflectors(self._file, seed, errors["reflector"])
        self._station: TrueStation | None = None
        self._nests: Mapping[str, Vector] = {}
        if cell.station:
            self._station = TrueStation(cell.station, up, seed, errors["station"], errors["station_drift"])
            self._nests = true_nests(cell.station, seed, errors["station"])
            memory.keep("station", lambda: {"bumps": self._bumps})
        faults.on_start(STATION_BUMP.name, self._bump)

    def station(self, on_ns: int) -> Matrix:
        """The instrument's frame, 4×4, base ← instrument, mm. Raises LookupError."""
        return self._placed().frame(on_ns, self._bumps)

    def tilt(self, on_ns: int) -> float:
        """Inclination of its standing axis from the vertical, degrees. Raises LookupError."""
        return self._placed().tilt_deg(self.station(on_ns))

    def reflectors(self, flange: Matrix, on_ns: int) -> tuple[Target, ...]:
        """Those on the robot, with the flange at this frame (4×4, base ← flange), then those in the nests."""
        wrong = self._faults.active(REFLECTOR_WRONG.name)
        constant_mm = self._file.constant_mm + (wrong.settings["mm"] if wrong else 0.0)
        on_robot = self._on_robot.at(flange, constant_mm)
        if not self._nests:
            return tuple(on_robot)
        station = vector(self.station(on_ns)[:3, 3])
        acceptance_deg = self._file.acceptance_deg
        nests = [
            Target(name, place, _towards(place, station), acceptance_deg, constant_mm)
            for name, place in self._nests.items()
        ]
        return *on_robot, *nests

    def _placed(self) -> TrueStation:
        if self._station is None:
            raise LookupError("the cell file has no section `station:`: write there where the instrument is")
        return self._station

    def _bump(self) -> None:
        fault = self._faults.active(STATION_BUMP.name)
        if fault and self._station:
            self._bumps.append((fault.settings["mm"], fault.settings["deg"]))
            self._memory.save()


def _bumps(state: Mapping[str, Any]) -> list[tuple[float, float]]:
    return [(float(mm), float(deg)) for mm, deg in state["bumps"]]


def _towards(place: Vector, other: Vector) -> Vector:
    """The unit direction from a place to another."""
    length = dist(place, other) or 1.0
    x, y, z = ((b - a) / length for a, b in zip(place, other, strict=True))
    return x, y, z


BRAKES_AFTER_S = 10.0
"""Standstill after which the brakes close [unconfirmed: of the order of a controller's default]."""

_FAST_DEG_S = 0.1
_NEAR_DEG = 0.05


@final
class MotorCurrents:
    """Amperes of A1…An, true means without any device's noise. `brakes_after_ns`: see `BRAKES_AFTER_S`."""

    def __init__(self, kernel: Kernel, arm: MovingArm, world: World) -> None:
        self.brakes_after_ns = round(BRAKES_AFTER_S * 1e9)
        self._kernel = kernel
        self._arm = arm
        self._world = world
        self._holding: Joints = ()
        self._held_at: Joints = ()

    def brakes_closed(self, time_ns: int | None = None) -> bool:
        """Whether the brakes hold the arm: it has stood for a while and nothing corrects it."""
        since = self._arm.standing_since()
        now = self._kernel.now if time_ns is None else time_ns
        return since is not None and now - since >= self.brakes_after_ns

    def at(self, time_ns: int | None = None) -> tuple[float, ...]:
        """Now, or at another moment of the present motion: weight and friction; 0 with closed brakes."""
        now = self._kernel.now if time_ns is None else time_ns
        joints, velocity = self._arm.joints_at(now)
        if self.brakes_closed(now):
            return (0.0,) * len(joints)
        friction = self._world.motors.friction(self._arm.sliding(now), velocity)
        return tuple(a + b for a, b in zip(self._hold(joints, velocity), friction, strict=True))

    def _hold(self, joints: Joints, velocity: Joints) -> Joints:
        """The weight's share; in fast motion it is worked out anew every 0.05°."""
        near = _NEAR_DEG if max(map(abs, velocity)) > _FAST_DEG_S else 0.0
        if not self._held_at or any(abs(a - b) > near for a, b in zip(joints, self._held_at, strict=True)):
            self._held_at, self._holding = joints, self._world.holding_currents(joints)
        return self._holding


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
