"""What every robot's commissioning moves: a tenth of a degree of each axis, and stops of a slow search.

Each motion is a search, so that every limit of the lowest layer holds.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Protocol, final

from cellctl.clock import Clock
from cellctl.devices import Figure, JointReadings, SearchEnd, SearchingRobot, SearchResult

TENTH_DEG, TENTH_DEG_S = 0.1, 0.1
_ASTRAY_DEG = 0.02
"""Largest error of a tenth of a degree, of its way back, and of every other axis: noise of encoder and friction."""

STOPS = 3
LINE_DEG, LINE_DEG_S = 0.5, 0.25
"""Of A1: 12 mm at 6 mm/s of a TCP that is 1.4 m away."""
_STEADY_S = 1.0
"""From the first step of the set-point until the stop: the speed is constant then."""
_LOOK_S = 0.02

_TOUCH_MM_S = 10.0
"""Fastest search of the shipped procedures, speed of the TCP."""


class MovingRobot(SearchingRobot, Protocol):
    """The robot, as the steps use it."""

    def searching(self) -> bool:
        """Whether a search goes along its line."""


@final
@dataclass(frozen=True, slots=True)
class Stopped:
    """A search that was told to stop at `stopped_ns` of the cell's time."""

    found: SearchResult
    stopped_ns: int

    @property
    def way_deg(self) -> float:
        """Of A1 after the stop."""
        return abs(self.found.resting[0] - self.found.joints_at(self.stopped_ns)[0])


async def _go(robot: MovingRobot, end: JointReadings, speed_deg_s: float) -> SearchResult:
    robot.clear_stop()
    return await robot.search(end, speed_deg_s)


async def tenths(robot: MovingRobot) -> list[Figure]:
    """Move each axis by a tenth of a degree and back; ends at the first one that does not follow."""
    figures: list[Figure] = []
    others: list[float] = []
    ways_back: list[float] = []
    for axis in range(robot.axes):
        start = await robot.joints()
        end = tuple(angle + TENTH_DEG * (i == axis) for i, angle in enumerate(start))
        moved = _difference((await _go(robot, end, TENTH_DEG_S)).resting, start)
        back = _difference((await _go(robot, start, TENTH_DEG_S)).resting, start)
        low, high = TENTH_DEG - _ASTRAY_DEG, TENTH_DEG + _ASTRAY_DEG
        figures.append(Figure(f"a{axis + 1}_deg", f"A{axis + 1} moved", moved[axis], "deg", least=low, most=high))
        others += [abs(angle) for i, angle in enumerate(moved) if i != axis]
        ways_back += map(abs, back)
        if not figures[-1].ok or max(others) > _ASTRAY_DEG:
            break  # the next axis would move on corrections that are wired wrongly
    return [
        *figures,
        Figure("others_deg", "other axes moved, at most", max(others), "deg", most=_ASTRAY_DEG),
        Figure("back_deg", "away from the start after the way back, at most", max(ways_back), "deg", most=_ASTRAY_DEG),
    ]


def _difference(a: JointReadings, b: JointReadings) -> JointReadings:
    return tuple(x - y for x, y in zip(a, b, strict=True))


async def stops(robot: MovingRobot, clock: Clock) -> list[Stopped]:
    """Stop A1 on its way, and go back, three times; ends at a search that ended before its stop."""
    found: list[Stopped] = []
    while len(found) < STOPS:
        start = await robot.joints()
        found.append(await _stopped_on_the_way(robot, clock, start))
        if found[-1].found.end is not SearchEnd.STOPPED:
            break
        await _go(robot, start, LINE_DEG_S)
    return found


def stop_figures(stopped: list[Stopped], longest_s: float) -> list[Figure]:
    """The longest of the ways after a stop, `longest_s`: that it may take; or that a search ended before its stop."""
    if (end := stopped[-1].found.end) is not SearchEnd.STOPPED:
        return [Figure("end", "end of the search", end.value, wanted=SearchEnd.STOPPED.value)]
    way_deg = max(each.way_deg for each in stopped)
    stop_s = way_deg / LINE_DEG_S
    return [
        Figure("stop_deg", f"way after a stop at {LINE_DEG_S:g} deg/s", way_deg, "deg"),
        Figure("stop_ms", "the same in time at that speed", stop_s * 1e3, "ms", most=longest_s * 1e3),
        Figure("stop_mm", f"the same at {_TOUCH_MM_S:g} mm/s", stop_s * _TOUCH_MM_S, "mm"),
    ]


async def _stopped_on_the_way(robot: MovingRobot, clock: Clock, start: JointReadings) -> Stopped:
    robot.clear_stop()
    search = asyncio.create_task(robot.search((start[0] + LINE_DEG, *start[1:]), LINE_DEG_S))
    try:
        while not search.done() and not robot.searching():
            await clock.sleep(_LOOK_S)
        await clock.sleep(_STEADY_S)
        robot.stop_now()
        stopped_ns = clock.now_ns()
        return Stopped(await search, stopped_ns)
    except BaseException:
        search.cancel()  # it holds the robot
        await asyncio.gather(search, return_exceptions=True)
        raise
