"""The motions common to all touches: to a sphere, along a line until contact, and back; a path is rejoined.

A path is a list of joint readings between which the controller moves in straight joint-space lines, so a robot that
was stopped on it is on one of these lines. Otherwise it was moved by hand, and a person must decide how it may move.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import dist
from typing import Any, Protocol, TypeVar, final

from cellctl.devices import (
    Contact,
    ContactProbe,
    DeviceError,
    DeviceRefused,
    JointReadings,
    MovingRobot,
    NoContact,
    ProbeNotOpen,
    SearchEnd,
    SearchingRobot,
    SearchResult,
)

ON_THE_WAY_DEG = 1.0
"""Largest distance from a planned line, as norm of the joint vector, that counts as on it (braking, following lag)."""

AT_A_POINT_DEG = 0.2
"""Within this distance of a point of the path, the robot counts as there."""


async def rejoin(
    robot: MovingRobot, way: Sequence[JointReadings], speed_percent: float, here: JointReadings | None = None
) -> int:
    """Move the robot back along `way` to one of its points; returns the index. here: None: its actual joints.

    Does not move if it is at the first point. Raises DeviceRefused if it is off the path; DeviceLost.
    """
    here = here or await robot.joints()
    index = last_point_before(way, here)
    if index is None:
        raise DeviceRefused(
            robot.name,
            f"is off its planned way, at {', '.join(f'{angle:.1f}' for angle in here)} deg",
            f"Move it by hand (T1), clear of everything, to {', '.join(f'{angle:.1f}' for angle in way[0])} deg.",
        )
    if index > 0 or dist(here, way[0]) > AT_A_POINT_DEG:
        await robot.move(tuple(way[index]), speed_percent)
    return index


def last_point_before(way: Sequence[JointReadings], here: JointReadings) -> int | None:
    """Index of the point of `way` that a robot at `here` passed last; None if it is off the path.

    If it is on several lines (the path crosses itself), the earliest counts: from there the whole path is planned.
    """
    if dist(here, way[0]) <= AT_A_POINT_DEG:
        return 0
    for index, (start, end) in enumerate(pairwise(way)):
        if _from_line(start, end, here) <= ON_THE_WAY_DEG:
            return index + 1 if dist(here, end) <= AT_A_POINT_DEG else index
    return None


def _from_line(start: JointReadings, end: JointReadings, here: JointReadings) -> float:
    """Distance of `here` from the straight joint-space line between `start` and `end`, degrees."""
    along = [b - a for a, b in zip(start, end, strict=True)]
    length = sum(step * step for step in along)
    if length == 0.0:
        return dist(here, start)
    share = sum((h - a) * step for h, a, step in zip(here, start, along, strict=True)) / length
    share = min(1.0, max(0.0, share))
    return dist(here, [a + share * step for a, step in zip(start, along, strict=True)])


Recorded = TypeVar("Recorded")

_PROBE_PATIENCE_S = 0.2
"""Largest age of the probe's last sign of life in a search; beyond it the robot holds by itself."""

_SETTLED_SHARE = 0.4
"""Share of the transfer speed for transfers from guard distance on: the tip is near the sphere."""

_MOVED_DEG = 0.01
"""Below this distance from the start the joints have not moved: twenty steps of a common encoder, about 0.1 mm."""


class Line(Protocol):
    """A path to a sphere: clear of it, then the search line, then back. Degrees, mm."""

    @property
    def sphere(self) -> str:
        """The sphere's name."""

    @property
    def origin(self) -> Sequence[float]:
        """Joints at the start of the path, which is the end of the previous one."""

    @property
    def approach(self) -> Sequence[Sequence[float]]:
        """Joints of the approach, the last ones clear of the sphere."""

    @property
    def start(self) -> Sequence[float]:
        """Joints at which the search begins."""

    @property
    def end(self) -> Sequence[float]:
        """Joints at which the search ends without contact."""

    @property
    def search_mm(self) -> float:
        """The tip's travel on the whole line."""

    @property
    def earliest_mm(self) -> float:
        """Least distance along the line of a contact with the sphere, mm."""

    @property
    def retreat(self) -> Sequence[Sequence[float]]:
        """Joints of the retreat, the first ones still near the sphere."""


@final
@dataclass(frozen=True, slots=True)
class Speeds:
    """Tip speed of searches, mm/s; share of axis speed of transfers, percent."""

    search_mm_s: float
    transfer_percent: float

    @property
    def near_percent(self) -> float:
        """Speed of transfers with the tip near a sphere, percent."""
        return self.transfer_percent * _SETTLED_SHARE


@final
@dataclass(frozen=True, slots=True)
class FoundContact:
    """A confirmed contact: actual joints (deg) at the search's start and at the contact's time; the search."""

    start: JointReadings
    joints: JointReadings
    found: SearchResult
    contact: Contact

    def row(self) -> dict[str, Any]:
        """The fields of a row that describe its search."""
        found, contact = self.found, self.contact
        return {
            "resting": tuple(found.resting),
            "time_ns": contact.time_ns,
            "time_sigma_ns": contact.sigma_ns,
            "tick": contact.tick,
            "bounces": contact.bounces,
            "stop_cycles": found.stop_cycles,
            "late": found.late,
            "lost": found.lost,
            "skipped": found.skipped,
        }


async def search_and_retreat(
    robot: SearchingRobot,
    probe: ContactProbe,
    line: Line,
    to_start: Callable[[], Awaitable[JointReadings]],
    speeds: Speeds,
    record: Callable[[FoundContact], Awaitable[Recorded]],
    after_miss: Callable[[], Awaitable[Line | None]] | None = None,
) -> Recorded:
    """Approach, go to the start of the line by `to_start`, search, `record` the contact, retreat.

    Returns what `record` returned.

    The contact is recorded before any further motion, so that errors on the retreat cannot lose it; it counts
    once its step is done: the robot is back and the loop open. A robot that was interrupted on this path continues
    from there; a robot off the path is not moved. after_miss: another line, from the end of this one's retreat and back
    there, for a robot that found nothing on this one; None: there is none.

    Raises NoContact once the robot is back at its start, and the devices' errors.
    """
    for target in await _left_of_approach(robot, line, speeds):
        await robot.move(tuple(target), speeds.transfer_percent)
    start = await to_start()
    result = await _search(robot, probe, line, start, speeds.search_mm_s)
    if isinstance(result, NoContact):
        await _retreat(robot, line, speeds)
        raise result
    if result is None:
        await _retreat(robot, line, speeds)
        other = await after_miss() if after_miss else None
        if other is None:
            what = f"no contact on {line.sphere} within {line.search_mm:.0f} mm"
            cure = "is the sphere where the cell file says, its earth lead on, the tip clean?"
            raise NoContact("probe", what, cure)
        to_other = partial(robot.move, tuple(other.start), speeds.near_percent)
        return await search_and_retreat(robot, probe, other, to_other, speeds, record)
    recorded = await record(result)
    await _retreat(robot, line, speeds)
    if await probe.touching():
        what = f"the loop is still closed, clear of {line.sphere}: the reported contact was not with the sphere"
        raise ProbeNotOpen("probe", what, "free the tip, clean it, look at its lead; then resume")
    return recorded


async def _retreat(robot: SearchingRobot, line: Line, speeds: Speeds) -> None:
    await robot.move(tuple(line.retreat[0]), speeds.near_percent)
    for target in line.retreat[1:]:
        await robot.move(tuple(target), speeds.transfer_percent)


async def _left_of_approach(robot: SearchingRobot, line: Line, speeds: Speeds) -> Sequence[Sequence[float]]:
    """The rest of the approach; an interrupted robot on the path is first brought back to a point of it.

    After an interruption in the search or retreat, it is brought to the search's start, and no approach is left.
    """
    before = [line.origin, *line.approach]
    way = [tuple(joints) for joints in (*before, line.start, line.end, *line.retreat)]
    passed = await rejoin(robot, way, speeds.near_percent)
    back_from = passed - len(before) - 2  # index into the retreat, whose first point is the start again
    for joints in reversed(line.retreat[: max(0, back_from)]):
        await robot.move(tuple(joints), speeds.near_percent)
    return before[passed + 1 :]


async def _search(
    robot: SearchingRobot, probe: ContactProbe, line: Line, start: JointReadings, speed_mm_s: float
) -> FoundContact | NoContact | None:
    """Search to the line's end; returns the contact, or why it is none of the sphere, or None where there was none.

    The robot stays at the search's end.
    """
    turn = sum((b - a) ** 2 for a, b in zip(start, line.end, strict=True)) ** 0.5
    speed_deg_s = speed_mm_s * turn / line.search_mm
    alive = robot.guard("probe")
    robot.clear_stop()  # before the probe can send one: later ones count
    await probe.arm(on_edge=robot.stop_now, on_alive=alive.beat)
    try:
        found = await robot.search(tuple(line.end), speed_deg_s, {"probe": _PROBE_PATIENCE_S})
        contact = await probe.contact() if found.end is SearchEnd.STOPPED else None
        pressed = await probe.touching()  # at the end of the travel too: the probe may report why there was no contact
    except BaseException:
        with suppress(DeviceError):  # the operator needs the reason that ended the search
            await probe.disarm()
        raise
    await probe.disarm()
    return _judged(line, start, found, contact, pressed=pressed)


def _judged(
    line: Line, start: JointReadings, found: SearchResult, contact: Contact | None, *, pressed: bool
) -> FoundContact | NoContact | None:
    """The contact if it is with the sphere: it held, the loop is still closed, the place is plausible. None: none."""
    if contact is None:
        return None
    joints = _joints_at(found, contact)
    if joints is None or math.dist(joints, found.joints[0]) < _MOVED_DEG:
        what = f"contact on {line.sphere} was not on the line: before the robot moved on it, or after the search"
        return NoContact("probe", what, "does something else close the loop: a cable, dirt, a disturbance?")
    if contact.confirmed is None:
        what = f"the probe did not report whether the contact on {line.sphere} held: its line was lost"
        return NoContact("probe", what, "look at the serial line: its health counts spoilt and repeated lines")
    if not contact.confirmed:
        return NoContact("probe", f"contact on {line.sphere} did not hold (a bounce)", "clean tip and sphere")
    if not pressed:
        what = f"the loop was closed for a moment only, and is open with the tip at rest on {line.sphere}"
        return NoContact("probe", what, "not a contact, but a disturbance? look at lead, earth and tip")
    way_mm = line.search_mm * math.dist(start, joints) / math.dist(start, line.end)
    if way_mm < line.earliest_mm:
        what = f"contact only {way_mm:.1f} mm on the way to {line.sphere}: something else was touched"
        return NoContact("probe", what, "is something on the sphere, or the sphere nearer than the cell file says?")
    return FoundContact(start, joints, found, contact)


def _joints_at(found: SearchResult, contact: Contact) -> JointReadings | None:
    """Joints at the contact; None if it was outside the search's time."""
    try:
        return found.joints_at(contact.time_ns)
    except ValueError:
        return None
