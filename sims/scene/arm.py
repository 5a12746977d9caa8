"""The arm in motion: where it is at any time, contacts and collisions on its way, its state between processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from math import isfinite, radians
from typing import Any, final

from sims.kernel import Event, Kernel
from sims.scene.contact import ContactLog, ContactLoop
from sims.scene.motions import FULL_SPEED_AFTER_S, Braking, Joints, Motion, PointToPoint, Standing, State, crossings
from sims.world.drives import PRESLIDING_DEG, lagging, slid
from sims.world.kinematics import Matrix, Vector
from sims.world.world import World


@final
@dataclass(frozen=True, slots=True)
class Stance:
    """Joints as they really are, degrees; the programmed ones; the scatter that goes with them, mm (None: to be drawn).

    `attempts`: how often each pose has been commanded, by its joints in 1e-4°; `attempt`: which one this is, from 0.
    `slack`: how far each link is ahead of its joint within the play, degrees; `sliding`: each joint's share of its
    Coulomb friction; none where nothing is known of them.
    """

    joints: Joints
    commanded: Joints
    scatter: Vector | None = None
    attempt: int = 0
    attempts: Mapping[str, int] = field(default_factory=dict)
    slack: Joints = ()
    sliding: Joints = ()

    def state(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "joints": self.joints,
            "commanded": self.commanded,
            "scatter": self.scatter,
            "attempt": self.attempt,
            "attempts": dict(self.attempts),
            "slack": self.slack,
            "sliding": self.sliding,
        }


def stance_from(state: Mapping[str, Any], axes: int) -> Stance:
    """The stance of a `state` that was kept. Raises ValueError, TypeError, LookupError, AttributeError."""
    x, y, z = _numbers(state["scatter"], 3)
    return Stance(
        joints=_numbers(state["joints"], axes),
        commanded=_numbers(state["commanded"], axes),
        scatter=(x, y, z),
        attempt=int(state["attempt"]),
        attempts={str(pose): int(count) for pose, count in state["attempts"].items()},
        slack=_numbers(state["slack"], axes) if state.get("slack") else (),
        sliding=_numbers(state["sliding"], axes) if state.get("sliding") else (),
    )


def _numbers(values: Any, count: int) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != count or not all(map(isfinite, numbers)):
        raise ValueError(f"{count} finite numbers are expected, not {values!r}")
    return numbers


LOOK_AHEAD_NS = 10_000_000
COLLISION_MM = 3.0
COLLISION_MARGIN_MM = 0.2
"""A motion that starts deep inside may come out, wherever the scatter of the new pose lies."""
_SWING = 0.15
"""A cubic leaves the stretch between its ends by no more than this × duration × the speeds at its ends (4/27)."""

Then = Callable[[], object]


@final
class MovingArm:
    """Follows one motion after another; looks 10 ms ahead for contact, and opens and closes the loop at the exact time.

    `on_collision` is called where a point-to-point motion pushes the tip over 3 mm deep into a sphere. In a search the
    torch's spring mount gives way instead: there a missed contact ends with the travel. And it is called wherever
    forearm, wrist or the tool's side run into plate, stem or sphere, in a search too; deeper, that is, than they stood.
    """

    def __init__(
        self,
        kernel: Kernel,
        world: World,
        loop: ContactLoop,
        log: ContactLog,
        stance: Stance,
        max_speeds: Sequence[float],
    ) -> None:
        self._kernel = kernel
        self._world = world
        self._loop = loop
        self._log = log
        self.on_collision: Then = lambda: None
        self._speeds = tuple(max_speeds)
        self._accelerations = tuple(speed / FULL_SPEED_AFTER_S for speed in max_speeds)
        self._attempts: Counter[str] = Counter(stance.attempts)
        self._motion: Motion = Standing(stance.joints, kernel.now)
        self._slack = stance.slack
        self._sliding = stance.sliding or (0.0,) * len(stance.joints)
        self._then: Then | None = None
        self._events: list[Event] = []
        self._clear_mm = 0.0
        self._deepest_mm: float | None = None
        self._free_mm = 0.0
        self._least_free_mm = self._least_free(stance.joints)
        self.attempt = stance.attempt
        self.commanded = stance.commanded
        self._scatter = self.draw(stance.joints) if stance.scatter is None else stance.scatter
        self._scatter_before = self._scatter
        world.warm(kernel.now)
        self._sense()

    def joints(self) -> Joints:
        """Actual joints now, degrees, as they really are (no encoder)."""
        return self._motion.at(self._kernel.now)

    def state(self) -> State:
        """Joints and velocities now."""
        now = self._kernel.now
        return State(self._motion.at(now), self._motion.velocity(now))

    @property
    def moving(self) -> bool:
        """Whether a motion is going on, be it between two interpolation cycles."""
        return not isinstance(self._motion, Standing)

    def standing_since(self) -> int | None:
        """Since when it has been at rest; None in motion or under a sensor's correction."""
        return None if self.moving else self._motion.start_ns

    def joints_at(self, time_ns: int) -> tuple[Joints, Joints]:
        """Joints and velocities at a moment of this motion, deg and deg/s."""
        return self._motion.at(time_ns), self._motion.velocity(time_ns)

    def sliding(self, time_ns: int) -> Joints:
        """Each joint's share of its Coulomb friction, −1 … 1, by the direction of its last motion."""
        motion = self._motion
        return slid(self._sliding, motion.at(motion.start_ns), motion.at(time_ns))

    def stance(self) -> Stance:
        """Its stance if it stopped now, to be stored."""
        commanded = self.readings() if self.moving else self.commanded
        scatter = self._scatter_now(self._kernel.now)
        slack = self._slack_at(self._kernel.now)
        sliding = self.sliding(self._kernel.now)
        return Stance(self.joints(), commanded, scatter, self.attempt, self._attempts, slack, sliding)

    def tip_changed(self) -> None:
        """The tip has become another: what it touches, and will touch, is looked at anew."""
        for event in self._events:
            event.cancel()
        self._events.clear()
        self._sense()
        self._look_ahead()

    def readings(self) -> Joints:
        """Actual joints now as the encoders show them."""
        return tuple(self._world.encoder(self.joints()))

    def links(self, time_ns: int) -> Joints:
        """Where the links are, degrees: the joints, less what their play and their friction hold back."""
        joints = self._motion.at(time_ns)
        if self._world.backlash:
            joints = tuple(joint + ahead for joint, ahead in zip(joints, self._slack_at(time_ns), strict=True))
        if self._world.wound_up:
            joints = lagging(joints, self._world.wound_up, self.sliding(time_ns))
        return joints

    def tcp(self, time_ns: int) -> Vector:
        """The TCP at a moment of this motion, mm."""
        return self._world.tcp(self.links(time_ns), self._scatter_now(time_ns))

    def flange(self, time_ns: int) -> Matrix:
        """The flange's frame at a moment of this motion, 4×4, base ← flange, mm."""
        return self._world.flange(self.links(time_ns), self._scatter_now(time_ns))

    def move(self, target: Joints, percent: float, then: Then) -> None:
        """Point to point at `percent` of the highest speeds; `then` is called on arrival."""
        self.run(self.point_to_point(self.joints(), target, percent, self._kernel.now), target, then)

    def point_to_point(self, start: Joints, target: Joints, percent: float, time_ns: int) -> PointToPoint:
        """The motion from `start` at `time_ns`, at `percent` of the highest speeds; nothing moves by it."""
        speeds = [speed * percent / 100.0 for speed in self._speeds]
        return PointToPoint(start, target, speeds, self._accelerations, time_ns)

    def run(self, motion: Motion, target: Joints, then: Then) -> None:
        """A motion that begins here and now, and ends at `target`; `then` is called on arrival."""
        before = self.scatter_now()
        self.commanded = target
        self._scatter_before, self._scatter = before, self.draw(target)
        deepest_mm = self.deepest_mm()
        self._follow(motion, then)
        self._deepest_mm = deepest_mm
        self._look_ahead()

    def brake(self, then: Then) -> None:
        """Stop any motion; `then` is called at standstill."""
        now = self._kernel.now
        state = self.state()
        self._scatter = self._scatter_before = self._scatter_now(now)
        self._follow(Braking(state.joints, state.velocity, self._accelerations, now), then)
        self._look_ahead()

    def deepest_mm(self) -> float:
        """The gap of the tip, negative, at which a motion from here counts as a collision."""
        now = self._kernel.now
        gap, _ = self._world.gap(self.links(now), self._scatter_now(now))
        return min(gap - COLLISION_MARGIN_MM, -COLLISION_MM)

    def follow_cycle(self, motion: Motion, scatter: Vector | None = None, deepest_mm: float | None = None) -> None:
        """One interpolation cycle of a controller that interpolates itself; the next motion must begin where it ends.

        `scatter`: at its end, where the program moves; None: as it is. `deepest_mm`: see there; None: in a search, in
        which the spring mount gives way.
        """
        if scatter is not None:
            self._scatter_before, self._scatter = self.scatter_now(), scatter
        self._follow(motion, None)
        self._deepest_mm = deepest_mm
        self._look_ahead()

    def stand(self) -> None:
        """The robot has come to rest where it is."""
        now = self._kernel.now
        self._follow(Standing(self.joints(), now), None)
        self._least_free_mm = self._least_free(self.joints())
        self._log.rest(now)

    def take_measured(self) -> None:
        """`PTP $AXIS_ACT_MEAS`: the programmed position becomes the measured one; nothing moves."""
        self.commanded = self.readings()

    def scatter_now(self) -> Vector:
        """The scatter of the pose now, mm."""
        return self._scatter_now(self._kernel.now)

    def draw(self, target: Joints) -> Vector:
        """The scatter of this visit to `target`, mm."""
        key = ",".join(str(round(joint * 1e4)) for joint in target)
        self.attempt = self._attempts[key]
        self._attempts[key] += 1
        return self._world.scatter(target, self.attempt)

    def _follow(self, motion: Motion, then: Then | None) -> None:
        for event in self._events:
            event.cancel()
        self._events.clear()
        if self._log.waiting:
            self._log.passed(self.tcp(self._kernel.now))
        self._slack, self._sliding = self._slack_at(motion.start_ns), self.sliding(motion.start_ns)
        self._motion, self._then, self._deepest_mm = motion, then, None

    def _look_ahead(self) -> None:
        """Schedule what happens on the next stretch of the motion, and its end."""
        start, motion = self._kernel.now, self._motion
        self._world.warm(start)
        end = min(start + LOOK_AHEAD_NS, motion.end_ns)
        way_mm = self._most_way(start, end)
        if end > start and self._strikes(end, way_mm):
            self._events.append(self._kernel.at(end, self.on_collision))
            return
        if end > start and self._may_touch(way_mm):
            gap = cache(self._gap)  # at start and end it is asked for twice
            self._sense(gap)
            for time, closed in crossings(gap, (start, (start + end) // 2, end)):
                self._events.append(self._kernel.at(time, partial(self._touch, closed)))
            self._clear_mm = gap(end)
            if self._deepest_mm is not None and self._clear_mm < self._deepest_mm:
                self._events.append(self._kernel.at(end, self.on_collision))
                return
        if end < motion.end_ns or self._then:
            self._events.append(self._kernel.at(end, self._go_on))

    def _go_on(self) -> None:
        self._events.clear()
        if self._log.waiting:
            self._log.passed(self.tcp(self._kernel.now))
        if self._kernel.now < self._motion.end_ns:
            self._look_ahead()
            return
        then = self._then
        self._scatter_before = self._scatter
        self.stand()
        self._sense()
        if then:
            then()

    def _most_way(self, start: int, end: int) -> float:
        """What no point of the robot moves farther than in this stretch, mm."""
        motion = self._motion
        swing = _SWING * (end - start) * 1e-9
        way = sum(
            abs(b - a) + swing * (abs(v) + abs(w))
            for a, b, v, w in zip(
                motion.at(start), motion.at(end), motion.velocity(start), motion.velocity(end), strict=True
            )
        )
        unwinding = max(self._world.wound_up, default=0.0) / PRESLIDING_DEG
        return radians(way) * (1.0 + unwinding) * self._world.reach_mm

    def _may_touch(self, way_mm: float) -> bool:
        """Whether the tip could reach a sphere in this stretch; keeps the lower bound of the gap up to date."""
        bound = self._clear_mm - way_mm - 0.1  # 0.1: the scatter's change on the way
        if bound <= 0.0:
            return True
        self._clear_mm = bound
        return False

    def _strikes(self, end: int, way_mm: float) -> bool:
        """Whether anything but the wire has run into something by the end of this stretch; keeps a lower bound too."""
        self._free_mm -= way_mm
        if self._free_mm <= 0.0:
            self._free_mm = self._world.free(self._motion.at(end))
        return self._free_mm < self._least_free_mm and not isinstance(self._motion, Braking)

    def _least_free(self, joints: Joints) -> float:
        """A motion that starts inside something may come out, but not go deeper."""
        self._free_mm = self._world.free(joints)
        return min(0.0, self._free_mm - COLLISION_MARGIN_MM)

    def _sense(self, gap: Callable[[int], float] | None = None) -> None:
        self._clear_mm = (gap or self._gap)(self._kernel.now)
        self._loop.set_closed(self._clear_mm <= 0.0)

    def _touch(self, closed: bool) -> None:
        if closed and not self._loop.closed:
            now = self._kernel.now
            _, which = self._world.gap(self.links(now), self._scatter_now(now))
            self._log.touched(now, self.joints(), self.tcp(now), self._world.spheres[which], self._world.ageing.worn_mm)
        self._loop.set_closed(closed)

    def _gap(self, time_ns: int) -> float:
        return self._world.gap(self.links(time_ns), self._scatter_now(time_ns))[0]

    def _slack_at(self, time_ns: int) -> Joints:
        """How far each link is ahead of its joint within the play, the way to there being straight."""
        play, motion = self._world.backlash, self._motion
        if not play:
            return self._slack
        start = motion.at(motion.start_ns)
        return play.after(self._slack or (0.0,) * len(start), start, motion.at(time_ns))

    def _scatter_now(self, time_ns: int) -> Vector:
        if self._scatter_before is self._scatter:
            return self._scatter
        share = self._motion.share(time_ns)
        (a, b, c), (x, y, z) = self._scatter_before, self._scatter
        return a + share * (x - a), b + share * (y - b), c + share * (z - c)
