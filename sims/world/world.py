"""The simulated truth: the true TCP of this robot, and its contacts."""

from __future__ import annotations

import hashlib
import random
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import radians, sqrt
from typing import final

import numpy as np

from sims.cell_content import Artefact, SimCell
from sims.conditions import REFERENCE_C, USUAL, Conditions, Payload
from sims.robot_file import RobotFile
from sims.world._gravity import GRAVITY_M_S2, Bending, Body, Compliance, Mass, drawn_body
from sims.world._obstacles import Obstacles
from sims.world.drives import Backlash, Gear, Motors, lagging
from sims.world.environment import Ageing, Environment, Surroundings, expansions, grown
from sims.world.errors import joint_zero_errors, tool_error, true_geometry
from sims.world.kinematics import (
    Arm,
    Chain,
    Matrix,
    Pose,
    Shown,
    Vector,
    angles_abc,
    chain_of,
    nominal_geometry,
    pose,
    vector,
)
from sims.world.true_places import TrueSphere, true_plate_z, true_spheres

ENCODER_DEG = 0.0005
NO_SCATTER: Vector = (0.0, 0.0, 0.0)


@final
class World:
    """One robot, its tool and the spheres around it, all errors drawn from `seed`.

    Joint readings are the controller's A1…An in degrees; points are in the robot's base frame (that of the robot
    file's `base`), mm; its z is up, unless the file's `mounting` says otherwise. The true chain is a product of
    perturbed screws, not a link table. `ageing` starts fresh and cold; `warm` brings it up to a
    time. `backlash`: the joints' play, None where it is switched off; the caller that moves the robot knows which way.
    `wound_up`: degrees that each link lags behind under its joint's whole Coulomb friction, none where that is off.
    """

    def __init__(self, cell: SimCell, seed: int) -> None:
        robot, errors = cell.robot, cell.simulate.errors
        nominal = nominal_geometry(robot)
        true = true_geometry(nominal, seed, errors["geometry"])
        zeros = joint_zero_errors(len(robot.joints), seed, errors["joint_zero"])
        taught = np.array(robot.tool.xyz, dtype=float)
        offset = taught + tool_error(seed, errors["tool"])
        self._seed = seed
        self._repeatability = errors["repeatability"] * robot.repeatability
        self._resolution = errors["encoder"] * ENCODER_DEG
        self._signs = [float(joint.sign) for joint in robot.joints]
        self._offsets = [float(joint.offset) for joint in robot.joints]
        self._true_offsets = [a + zero for a, zero in zip(self._offsets, zeros, strict=True)]
        self._geometry = true
        self._tool_pose = pose(vector(offset), robot.tool.abc)
        self._chain = self._warm_chain = chain_of(true, self._tool_pose)
        self._warm_c = REFERENCE_C
        self._gear, self.backlash = _drives(len(robot.joints), seed, errors)
        body = drawn_body(robot, nominal, seed)
        self._compliance = _compliance(robot, body, self._chain, errors["compliance"])
        self.motors = Motors(body, true.axes, self._signs, robot.down, seed)
        self.wound_up = self._wound_up(errors["friction_torsion"])
        self._expansions = expansions(len(robot.joints), seed, errors["expansion"])
        self._each_expands = any(self._expansions)
        self._surroundings = Surroundings(seed, errors["air"])
        self._down = robot.down
        self.payload = cell.payload
        self._bending = Bending(float(taught[2]), robot.tool.mass, errors["deflection"])
        self._sag_mm = self._bending.sag_mm(self.payload)
        self._payload_place = self._place_of(self.payload)
        self._shown = Shown(robot, nominal)
        self._forearm = Arm(true.axes[:-2])
        self._elbow = true.axes[-3:][0].point
        self._elbow_to_wrist = vector(np.array(true.axes[-2:][0].point) - self._elbow)
        self.spheres: list[TrueSphere] = true_spheres(cell.artefact, seed, errors["placement"])
        self._obstacles = _obstacles(cell.artefact, self.spheres)
        self.reach_mm = _reach(self._shown.arm, self._shown.tcp)
        links_mm = _reach(self._shown.arm, vector(nominal.flange[:3, 3]))
        self.ageing = Ageing(errors["wear"], errors["warm_up"], links_mm)

    def true_tcp(self, readings: Sequence[float], conditions: Conditions = USUAL) -> Vector:
        """The mean TCP, with deflection, without the robot's scatter. Raises Falls."""
        chain, angles = self._at(readings, conditions)
        return self._tip(chain, angles, NO_SCATTER, self._bending.sag_mm(self._payload_of(conditions)))

    def true_pose(self, readings: Sequence[float], conditions: Conditions = USUAL) -> Pose:
        """`true_tcp`, and the tool's angles, turned as all joints are but not as the tool bends. Raises Falls."""
        chain, angles = self._at(readings, conditions)
        _, along_x, along_z = chain.arm.carry(angles, chain.tcp, chain.tool_x, chain.tool_z)
        sag_mm = self._bending.sag_mm(self._payload_of(conditions))
        return *self._tip(chain, angles, NO_SCATTER, sag_mm), *angles_abc(along_x, along_z)

    def true_flange(self, readings: Sequence[float], conditions: Conditions = USUAL) -> Matrix:
        """The mean flange of the cold robot, 4×4, base ← flange, mm. Raises Falls."""
        return _flange_of(*self._at(readings, conditions))

    def links_after(self, readings: Sequence[float], directions: Sequence[int]) -> Sequence[float]:
        """Where the links are, degrees, after long ways in these directions (0: in the middle); none given: all 0."""
        if self.backlash:
            slack = self.backlash.behind(directions)
            readings = [reading + ahead for reading, ahead in zip(readings, slack, strict=True)]
        if self.wound_up and directions:
            readings = lagging(readings, self.wound_up, directions)
        return readings

    def tcp(self, readings: Sequence[float], scatter: Vector) -> Vector:
        """The TCP now, `scatter` being what `scatter()` drew for this approach.

        `readings`: less what the joints' play holds back, where there is any. Raises Falls.
        """
        return self._tip(self._warm_chain, self._angles(readings, self.payload), scatter, self._sag_mm)

    def flange(self, readings: Sequence[float], scatter: Vector) -> Matrix:
        """The flange now, 4×4, base ← flange, as `tcp`. Raises Falls."""
        found = _flange_of(self._warm_chain, self._angles(readings, self.payload))
        found[:3, 3] = (1.0 + self._even_expansion) * found[:3, 3] + scatter
        return found

    def environment(self, time_ns: int) -> Environment:
        """Temperatures and air at a time of the cell."""
        return self._surroundings.at(self.ageing.on_ns(time_ns), self.ageing.rise_k(time_ns))

    def warm(self, time_ns: int) -> None:
        """The robot has been on until this time of the cell: its links have the length of their temperature."""
        self.ageing.warm(time_ns)
        if self._each_expands:
            arm_c = round(self.environment(time_ns).arm_c, 2)
            if arm_c != self._warm_c:
                self._warm_c, self._warm_chain = arm_c, self._chain_at(arm_c)

    @property
    def up(self) -> Vector:
        """Opposite to gravity, a unit vector in the base frame."""
        x, y, z = self._down
        return -x, -y, -z

    @property
    def _even_expansion(self) -> float:
        """The share by which all links are longer, where they have no rates of their own."""
        return 0.0 if self._each_expands else self.ageing.expansion

    def _chain_at(self, temperature_c: float) -> Chain:
        return chain_of(grown(self._geometry, self._expansions, temperature_c), self._tool_pose)

    def _at(self, readings: Sequence[float], conditions: Conditions) -> tuple[Chain, list[float]]:
        """The chain and its model angles, rad."""
        chain = self._chain
        if conditions.temperature_c != REFERENCE_C:
            chain = self._chain_at(conditions.temperature_c)
        links = self.links_after(readings, conditions.directions)
        return chain, self._angles(links, self._payload_of(conditions))

    def _wound_up(self, share: float) -> tuple[float, ...]:
        """`share`: of the friction's torque, that the drives' springs carry."""
        if not (share and self._compliance):
            return ()
        return tuple(share * degrees for degrees in self.motors.wound_up(self._compliance.rates))

    def _payload_of(self, conditions: Conditions) -> Payload:
        kg = conditions.payload_kg
        return self.payload if kg is None else Payload(kg, conditions.payload_at)

    def _angles(self, readings: Sequence[float], payload: Payload) -> list[float]:
        """Model angles, rad, of the true chain: where the links are, not the drives."""
        if self._gear:
            readings = self._gear.turned(readings)
        angles = [
            radians(sign * reading + offset)
            for sign, reading, offset in zip(self._signs, readings, self._true_offsets, strict=True)
        ]
        if not self._compliance:
            return angles
        at = self._payload_place if payload is self.payload else self._place_of(payload)
        return self._compliance.sagged(angles, payload.kg, at)

    def _place_of(self, payload: Payload) -> Vector | None:
        """Its centre of gravity at model zero in the base frame, mm; None: at the TCP."""
        flange = self._geometry.flange
        return vector(flange[:3, :3] @ payload.at + flange[:3, 3]) if payload.at else None

    def _tip(self, chain: Chain, angles: Sequence[float], scatter: Vector, sag_mm: float) -> Vector:
        (x, y, z), (ux, uy, uz) = self._carried(chain, angles)
        gx, gy, gz = self._down  # the load bends the tool by what of it is across the flange's z
        along = -sag_mm * (gx * ux + gy * uy + gz * uz) - self.ageing.worn_mm
        return (
            x + along * ux + sag_mm * gx + scatter[0],
            y + along * uy + sag_mm * gy + scatter[1],
            z + along * uz + sag_mm * gz + scatter[2],
        )

    def _carried(self, chain: Chain, angles: Sequence[float]) -> tuple[Vector, ...]:
        """The unbent TCP and the flange's z; warm links are longer, the tool is not."""
        expansion = self._even_expansion
        if not expansion:
            return chain.arm.carry(angles, chain.tcp, chain.flange_z)
        (x, y, z), (a, b, c), across = chain.arm.carry(angles, chain.flange, chain.offset, chain.flange_z)
        return (x + expansion * x + a, y + expansion * y + b, z + expansion * z + c), across

    def gap(self, readings: Sequence[float], scatter: Vector) -> tuple[float, int]:
        """From the tip to the nearest sphere's surface, mm (negative inside), and which sphere; infinity without."""
        x, y, z = self.tcp(readings, scatter)
        nearest, which = float("inf"), -1
        for i, sphere in enumerate(self.spheres):
            cx, cy, cz = sphere.centre
            gap = sqrt((x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2) - sphere.touch_mm
            if gap < nearest:
                nearest, which = gap, i
        return nearest, which

    def free(self, readings: Sequence[float]) -> float:
        """How far forearm, wrist and tool are from running into anything, mm, negative where they do.

        The wire's contact with a sphere is `gap`'s; the tool is taken unbent and unworn, without scatter.
        """
        return self._obstacles.gap(*self._body(readings))

    def blocked(self, readings: Sequence[float], start: Vector, end: Vector) -> bool:
        """Is anything between two points, mm: a sphere, a stem, the plate, forearm, wrist or the tool's tube?"""
        return self._obstacles.between(start, end, *self._body(readings))

    def _body(self, readings: Sequence[float]) -> tuple[Vector, Vector, Vector, Vector]:
        """Elbow, wrist, flange and tip, the tool taken unbent and unworn, without scatter."""
        angles = self._angles(readings, self.payload)
        chain = self._warm_chain
        flange, offset = chain.arm.carry(angles, chain.flange, chain.offset)
        # both are on the forearm: the elbow's axis turns it, and goes through the elbow
        elbow, on = self._forearm.carry(angles[: len(self._forearm.axes)], self._elbow, self._elbow_to_wrist)
        return elbow, _sum(elbow, on), flange, _sum(flange, offset)

    def scatter(self, target: Sequence[float], attempt: int) -> Vector:
        """Where the tool ends up beside its mean at the `attempt`-th (from 0) move to `target`, mm.

        A function of seed, target (to 1e-4°) and attempt alone: time plays no part. Its 3-D RMS is the robot file's
        repeatability.
        """
        key = f"{self._seed}|{attempt}|" + ",".join(str(round(reading * 1e4)) for reading in target)
        draw = random.Random(hashlib.sha256(key.encode()).digest())
        sigma = self._repeatability / sqrt(3.0)
        return draw.gauss(0.0, sigma), draw.gauss(0.0, sigma), draw.gauss(0.0, sigma)

    def holding_currents(self, readings: Sequence[float]) -> tuple[float, ...]:
        """Amperes of each motor that hold links, tool and payload there, without friction. Raises Falls."""
        payload = Mass(self.payload.kg * GRAVITY_M_S2, self._payload_place or self._chain.tcp)
        return self.motors.holding(self._angles(readings, self.payload), payload if self.payload.kg else None)

    def encoder(self, joints: Sequence[float]) -> list[float]:
        """What the controller reads where the joints are at `joints`, degrees."""
        step = self._resolution
        return [round(joint / step) * step for joint in joints] if step else list(joints)

    def shown_pose(self, readings: Sequence[float]) -> Pose:
        """What the controller, which knows the nominal model and the taught tool only, shows as X Y Z A B C."""
        return self._shown.pose(readings)


def _flange_of(chain: Chain, angles: Sequence[float]) -> Matrix:
    place, along_x, along_z = chain.arm.carry(angles, chain.flange, chain.flange_x, chain.flange_z)
    found = np.eye(4)
    found[:3, 0], found[:3, 1], found[:3, 2] = along_x, np.cross(along_z, along_x), along_z
    found[:3, 3] = place
    return found


def _drives(joints: int, seed: int, errors: Mapping[str, float]) -> tuple[Gear | None, Backlash | None]:
    """None for what is switched off, so that it costs nothing."""
    gear, backlash = errors["gear"], errors["backlash"]
    return Gear(joints, seed, gear) if gear else None, Backlash(joints, seed, backlash) if backlash else None


def _compliance(robot: RobotFile, body: Body, true: Chain, scale: float) -> Compliance | None:
    return Compliance(body, true.arm.axes, true.tcp, scale, robot.down) if scale else None


def _obstacles(artefact: Artefact, spheres: Sequence[TrueSphere]) -> Obstacles:
    """The true spheres on their plate, without the tip's radius."""
    stem_radius = artefact.plate.stem_radius if artefact.plate else 0.0
    bare = [(sphere.centre, sphere.touch_mm - artefact.tip_radius) for sphere in spheres]
    return Obstacles(bare, true_plate_z(artefact, spheres), stem_radius)


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _reach(arm: Arm, tip: Vector) -> float:
    """An upper bound of the tip's distance from any axis, mm: the way along the axes' points, stretched."""
    points = [np.array(axis.point) for axis in arm.axes] + [np.array(tip)]
    return float(sum(np.linalg.norm(b - a) for a, b in pairwise(points)))
