"""The controller's motions: each a generator that gives the joints' target once in a cycle; and what holds them.

Radians, metres and seconds, as URScript has them. The arm follows the target as its servo loops do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import degrees, hypot, radians
from typing import Protocol, final

from sims.scene.arm import MovingArm
from sims.scene.motions import Cycle, State
from sims.ur._kinematics import AXES, Joints, Model
from sims.ur._poses import NO_TOOL, Pose, between, matrix_of, vector_of
from sims.ur._profiles import Trapezoid, followed, towards
from sims.ur._script_expressions import PoseValue, Running, ScriptError, Value
from sims.world.kinematics import Vector

UNATTENDED_RAD_S2 = 10.0
"""A motion that no command goes on with is braked by this."""
STOP_S = 0.2
"""A protective or emergency stop takes each joint from its highest speed to standstill in this time."""
PAUSE_S = 0.25
"""In which a pause brakes along the path."""
SPEED_SHARE = 1.05
"""Of a joint's highest speed: a target faster than that is a protective stop."""
SETTLED_RAD, SETTLED_RAD_S = 1e-7, 1e-5
STEADY_RAD_S = 1e-3
ZERO: Joints = (0.0,) * AXES

SUDDEN_SPEED = "Path sanity check failed: Sudden change in target speed"
BUSY = "Another thread is already controlling the robot"

Fault = Callable[[int, int, str], object]
"""A protective stop: code, argument, text."""


class Holder(Protocol):
    """What a motion tells the controller."""

    def announce_move(self) -> None:
        """A movej or movel begins."""

    def announce_speed(self) -> None:
        """A speedj or speedl begins at rest."""

    def protective_stop(self, code: int, argument: int, text: str) -> None:
        """The arm cannot do what is asked of it."""


@final
@dataclass(frozen=True, slots=True)
class Limits:
    """Of each joint: places in rad, highest speeds in rad/s."""

    least: Joints
    most: Joints
    speed: Joints


@final
class Motion:
    """The target of the joints now, `target` and `speed`, and the generators that move it, cycle by cycle."""

    def __init__(
        self, arm: MovingArm, model: Model, limits: Limits, cycle_s: float, lag_s: float, holder: Holder
    ) -> None:
        self.arm, self.model, self.limits, self.cycle_s = arm, model, limits, cycle_s
        self._holder = holder
        self._omega = 2.0 / lag_s if lag_s else 0.0
        self.target: Joints = tuple(radians(joint) for joint in arm.commanded)
        self.speed: Joints = ZERO
        self.acceleration: Joints = ZERO
        self.tool_pose: Pose = NO_TOOL
        self.tool = matrix_of(NO_TOOL)
        self.slider, self._pace, self.pausing = 1.0, 1.0, False
        self._next: Joints | None = None
        self._next_speed: Joints = ZERO
        self._scatter: Vector | None = None
        self._twist: tuple[float, ...] = ()
        self._interruptions = 0
        self._deepest_mm: float | None = None

    # what is asked for

    @property
    def moving(self) -> bool:
        """Whether target or arm move."""
        return self.arm.moving or any(self.speed)

    @property
    def paused(self) -> bool:
        """Whether a pause has come to rest."""
        return self.pausing and self._pace <= 0.0

    @property
    def scaling(self) -> float:
        """By which trajectories are slower than commanded: the slider, and a pause on its way."""
        return self.slider * self._pace

    def set_tool(self, pose: Sequence[float]) -> None:
        """The TCP in the flange's frame."""
        x, y, z, a, b, c = (float(part) for part in pose)
        self.tool_pose, self.tool = (x, y, z, a, b, c), matrix_of(pose)

    def actual(self) -> Joints:
        """As the encoders show it, rad."""
        return tuple(radians(joint) for joint in self.arm.readings())

    def actual_speed(self) -> Joints:
        """Of the joints, rad/s."""
        return tuple(radians(speed) for speed in self.arm.state().velocity)

    def steady(self) -> bool:
        """Whether the arm stands."""
        return max(map(abs, self.actual_speed())) < STEADY_RAD_S

    # the generators

    def move_joints(self, goal: Joints, a: float, v: float, seconds: float) -> Running:
        """movej: every joint in proportion, the one with the longest way at this speed and acceleration."""
        self._holder.announce_move()
        yield from self.stop_joints(a)
        while True:
            start, interruptions = self.target, self._interruptions
            ways = [b - s for b, s in zip(goal, start, strict=True)]
            longest = max(map(abs, ways))
            if longest == 0.0:
                return
            fastest = min(limit * longest / abs(way) for limit, way in zip(self.limits.speed, ways, strict=True) if way)
            profile = Trapezoid.of(longest, min(v, fastest), a, seconds)
            yield from self._along(profile, goal, partial(_on, start, ways))
            if interruptions == self._interruptions:
                return

    def move_line(self, goal: Sequence[float], a: float, v: float, seconds: float) -> Running:
        """movel: the TCP straight, turning about one axis; m/s and m/s², for a pure turn rad/s and rad/s²."""
        self._holder.announce_move()
        yield from self.stop_line(a)
        while True:
            start, interruptions = self.model.tcp(self.target, self.tool), self._interruptions
            way = hypot(*(g - s for g, s in zip(goal[:3], start[:3], strict=True)))
            turn = hypot(*vector_of(matrix_of(start)[:3, :3].T @ matrix_of(goal)[:3, :3]))
            if max(way, turn) < 1e-9:
                return
            end = self._solved(goal, self.target)
            profile = Trapezoid.of(max(way, turn), v, a, seconds)
            yield from self._along(profile, end, partial(self._on_line, start, goal))
            if interruptions == self._interruptions:
                return

    def speed_joints(self, speeds: Sequence[float], a: float, seconds: float) -> Running:
        """speedj: until the speed is reached, or for a time."""
        self._begin_speed()
        passed = 0.0
        while True:
            wanted = [speed * self.scaling for speed in speeds]
            reached = self._go_speed(towards(self.speed, wanted, a * self.cycle_s))
            yield
            passed += self.cycle_s
            if passed >= seconds - 1e-9 if seconds > 0.0 else reached == tuple(wanted):
                return

    def speed_line(self, velocity: Sequence[float], a: float, seconds: float, turning: float) -> Running:
        """speedl: of the TCP. `turning`: angular acceleration, rad/s²."""
        self._begin_speed()
        passed = 0.0
        while True:
            twist = self._twist or self.model.velocity(self.target, self.tool, self.speed)
            wanted = [part * self.scaling for part in velocity]
            now = (
                *towards(twist[:3], wanted[:3], a * self.cycle_s),
                *towards(twist[3:], wanted[3:], turning * self.cycle_s),
            )
            self._go_speed(self._speeds(now))
            self._twist = now
            yield
            passed += self.cycle_s
            if passed >= seconds - 1e-9 if seconds > 0.0 else now == tuple(wanted):
                return

    def stop_joints(self, a: float) -> Running:
        """stopj."""
        while any(self.speed):
            self._go_speed(towards(self.speed, ZERO, a * self.cycle_s))
            yield

    def stop_line(self, a: float) -> Running:
        """stopl."""
        while any(self.speed):
            twist = self._twist or self.model.velocity(self.target, self.tool, self.speed)
            size = hypot(*twist[:3]) or hypot(*twist[3:])
            share = max(0.0, 1.0 - a * self.cycle_s / size) if size > 1e-9 else 0.0
            now = tuple(part * share for part in twist)
            self._go_speed(self._speeds(now) if share else ZERO)
            self._twist = now if share else ()
            yield

    def servo(self, goal: Joints, seconds: float, lookahead_s: float, gain: float) -> Running:
        """servoj: the target follows `goal` as a critically damped filter.

        More gain and less look-ahead make it sharper.
        """
        omega = 2.0 * gain / (300.0 * lookahead_s)
        for _ in range(max(1, round(seconds / self.cycle_s))):
            found = [
                followed(x, v, u, u, omega, self.cycle_s) for x, v, u in zip(self.target, self.speed, goal, strict=True)
            ]
            self._go(tuple(x for x, _ in found), tuple(v for _, v in found))
            yield

    # each cycle

    def interrupt(self) -> None:
        """A stop took the arm off its path: the motion begins anew from where it then stands."""
        self._interruptions += 1
        self._next = None

    def step(self, time_ns: int, end_ns: int, *, stopping: bool) -> None:
        """The cycle from `time_ns` to `end_ns`. `stopping`: the safety system brakes the arm, whatever is commanded."""
        if self.pausing:
            self._pace = max(0.0, self._pace - self.cycle_s / PAUSE_S)
        else:
            self._pace = min(1.0, self._pace + self.cycle_s / PAUSE_S)
        if stopping or self._next is None:
            self._brake(stopping=stopping)
        before, speed = self.target, self.speed
        self.acceleration = tuple((n - s) / self.cycle_s for n, s in zip(self._next_speed, speed, strict=True))
        self.target, self.speed = self._next or self.target, self._next_speed
        scatter, self._next, self._scatter = self._scatter, None, None
        self._check()
        self._follow(before, time_ns, end_ns, scatter)

    def _brake(self, *, stopping: bool) -> None:
        if not any(self.speed):
            self._next, self._next_speed = self.target, ZERO
            return
        if stopping:
            share = max(abs(s) / limit for s, limit in zip(self.speed, self.limits.speed, strict=True))
            slower = tuple(s * max(0.0, 1.0 - self.cycle_s / STOP_S / share) for s in self.speed)
        else:
            slower = towards(self.speed, ZERO, UNATTENDED_RAD_S2 * self.cycle_s)
        self._next = None
        self._go_speed(slower)
        self._scatter = None

    def _check(self) -> None:
        """Limits of the target, each a protective stop."""
        for number, (q, low, high) in enumerate(zip(self.target, self.limits.least, self.limits.most, strict=True)):
            if not low - 1e-9 <= q <= high + 1e-9 and any(self.speed):
                self._holder.protective_stop(150, number, "Protective Stop: Position close to joint limits")
                return
        for number, (v, limit) in enumerate(zip(self.speed, self.limits.speed, strict=True)):
            if abs(v) > SPEED_SHARE * limit:
                self._holder.protective_stop(
                    204, 2, f"Path sanity check failed: Sudden change in target speed, joint {number}"
                )
                return

    def _follow(self, before: Joints, time_ns: int, end_ns: int, scatter: Vector | None) -> None:
        """The arm goes after the target."""
        state = self.arm.state()
        wanted = tuple(degrees(q) for q in self.target)
        far = max(abs(q - x) for q, x in zip(wanted, state.joints, strict=True))
        near = far < degrees(SETTLED_RAD) and max(map(abs, state.velocity)) < degrees(SETTLED_RAD_S)
        if near and before == self.target and not any(self.speed):
            self._settle(wanted)
            return
        if self._deepest_mm is None:
            self._deepest_mm = self.arm.deepest_mm()
        if self._omega:
            found = [
                followed(x, v, degrees(b), u, self._omega, self.cycle_s)
                for x, v, b, u in zip(state.joints, state.velocity, before, wanted, strict=True)
            ]
            after = State(tuple(x for x, _ in found), tuple(v for _, v in found))
        else:
            after = State(wanted, tuple(degrees(v) for v in self.speed))
        self.arm.follow_cycle(Cycle(state, after, time_ns, end_ns), scatter, self._deepest_mm)

    def _settle(self, wanted: Joints) -> None:
        if self.arm.moving:
            self.arm.stand()
            self.arm.commanded = wanted
            self._deepest_mm = None

    def _along(self, profile: Trapezoid, goal: Joints, place: Callable[[float], Joints]) -> Running:
        """Along a way, to its end or to an interruption; the scatter goes over to that of the goal."""
        interruptions, passed = self._interruptions, 0.0
        old, new = self.arm.scatter_now(), self.arm.draw(tuple(degrees(q) for q in goal))
        while passed < profile.seconds:
            passed += self.cycle_s * self.scaling
            share = profile.at(passed)
            self._go(place(share) if share < 1.0 else goal)
            x, y, z = (a + share * (b - a) for a, b in zip(old, new, strict=True))
            self._scatter = (x, y, z)
            yield
            if interruptions != self._interruptions:
                return
        self.speed = ZERO  # the target arrives with what is left of its speed by the profile's last part of a cycle

    def _begin_speed(self) -> None:
        if not any(self.speed):
            self._holder.announce_speed()

    def _go(self, joints: Joints, speed: Joints | None = None) -> None:
        if self._next is not None:
            raise ScriptError(BUSY)
        self._twist = ()
        self._next = joints
        self._next_speed = speed or tuple((n - q) / self.cycle_s for n, q in zip(joints, self.target, strict=True))

    def _go_speed(self, speed: Sequence[float]) -> Joints:
        """A cycle that ends with this speed."""
        wanted = tuple(speed)
        self._go(tuple(q + v * self.cycle_s for q, v in zip(self.target, wanted, strict=True)), wanted)
        return wanted

    def _solved(self, pose: Sequence[float], near: Joints) -> Joints:
        joints = self.model.joints_at(pose, near, self.tool)
        if joints is None:
            raise ScriptError("get_inverse_kin: unable to find an inverse kinematics solution")
        return joints

    def _speeds(self, twist: Sequence[float]) -> Joints:
        speeds = self.model.speeds_for(self.target, self.tool, twist)
        if speeds is None or max(map(abs, speeds)) > 10.0 * max(self.limits.speed):
            self._holder.protective_stop(154, 0, "Protective Stop: Position in singularity")
            return self.speed
        return speeds

    def _on_line(self, start: Pose, goal: Sequence[float], share: float) -> Joints:
        return self._solved(between(start, goal, share), self.target)

    def joints_of(self, value: Value) -> Joints:
        """Six joints, or those of a pose near the target. Raises ScriptError."""
        if isinstance(value, PoseValue):
            return self._solved(value, self.target)
        return six(value)


def six(value: Value) -> Joints:
    """Six numbers of a list. Raises ScriptError."""
    numbers = isinstance(value, list) and all(isinstance(part, (int, float)) for part in value)
    if not numbers or len(value) != AXES:
        raise ScriptError("Type error: a list of six numbers is expected")
    return tuple(float(part) for part in value)


def _on(start: Joints, ways: Sequence[float], share: float) -> Joints:
    return tuple(s + share * way for s, way in zip(start, ways, strict=True))
