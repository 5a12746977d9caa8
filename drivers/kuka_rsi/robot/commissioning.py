"""The commissioning of a KUKA robot: a minute of telegrams at rest, a tenth of a degree of each axis, stops.

All of it in T1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from statistics import fmean, median
from typing import Protocol, final

from cellctl.clock import Clock
from cellctl.devices import CommissioningStep, DeviceRefused, Figure, Person, SearchResult
from drivers.commissioning_motions import (
    LINE_DEG,
    LINE_DEG_S,
    STOPS,
    TENTH_DEG,
    TENTH_DEG_S,
    MovingRobot,
    stop_figures,
    stops,
    tenths,
)
from drivers.kuka_rsi.cyclic.following import LONGEST_LAG_S
from drivers.kuka_rsi.cyclic.shared_block import SessionFacts

_T1 = "Select T1 with an override of 10 %, set CC_ALLOW_T1=TRUE, start CELLCTL, and hold the enabling switch"

_SESSION_S = 30.0
"""Length of each of the two sessions: a minute of telegrams."""

_LATE_SHARE = 0.01
"""Largest share of answers that are late by the controller's Delay, and of telegrams that are lost or skipped. It is 75
in a session at 4 ms: a controller that never resets its count stops after `Timeout`, 100 as a rule."""

_CYCLES_OF_STOP = 1.5
"""From the telegram whose answer is the first with the stop until the controller's set-point stands: the answer is
taken after one cycle, and its half step takes half of the next. The rest is the axes' lag."""


@final
@dataclass(frozen=True, slots=True)
class WatchedSession:
    """An RSI session at rest: telegrams, `counts` (late, lost, skipped), how much later than the fastest ones each
    arrived (ns), the learnt cycle (ns).
    """

    telegrams: int
    counts: dict[str, int]
    delays_ns: list[int]
    cycle_ns: int
    facts: SessionFacts


class WatchedRobot(MovingRobot, Protocol):
    """The robot, as the steps use it."""

    async def watch_telegrams(self, seconds: float) -> WatchedSession:
        """An RSI session at rest."""


def steps_of(robot: WatchedRobot, clock: Clock) -> tuple[CommissioningStep, ...]:
    """The steps of `robot`; the first one without motion."""
    return (
        CommissioningStep(
            "telegrams",
            "a minute of telegrams, in two sessions",
            f"In T1, RSI is on twice for {_SESSION_S:g} s with a correction of 0. The brakes are open; nothing moves.",
            "answers in time: a search corrects the robot in every cycle",
            partial(_telegrams, robot),
        ),
        CommissioningStep(
            "tenth",
            "a tenth of a degree of each axis",
            f"In T1, each axis moves by +{TENTH_DEG:g}° and back by RSI, A1 first, at {TENTH_DEG_S:g} deg/s.",
            "each correction moves its own axis, in its direction, by its amount",
            partial(_tenths, robot),
            moves=True,
        ),
        CommissioningStep(
            "stop",
            "the distance of a stop",
            f"In T1, A1 goes {STOPS} times towards +{LINE_DEG:g}° at {LINE_DEG_S:g} deg/s, is stopped on the way, "
            "and goes back.",
            "a touch presses the tip by no more than this distance",
            partial(_stops, robot, clock),
            moves=True,
        ),
    )


async def _in_t1(robot: WatchedRobot, person: Person) -> None:
    """Raises DeviceRefused in another mode."""
    if (await robot.health()).mode != "T1":
        await person.asked(_T1, robot.name, "T1")
        mode = (await robot.health()).mode
        if mode != "T1":
            raise DeviceRefused(robot.name, f"the controller is in {mode}, not in T1", f"{_T1}; then try again.")


async def _telegrams(robot: WatchedRobot, person: Person) -> list[Figure]:
    await _in_t1(robot, person)
    sessions = [await robot.watch_telegrams(_SESSION_S) for _ in range(2)]
    total = sum(each.telegrams for each in sessions)
    missed = {name: sum(each.counts[name] for each in sessions) for name in ("late", "lost", "skipped")}
    delays_ms = [delay * 1e-6 for each in sessions for delay in each.delays_ns]
    facts = [each.facts for each in sessions]
    ports, marks = [each.port for each in facts], [each.mark for each in facts]
    first = [each.first_delay for each in facts if each.first_delay is not None]
    rises = [
        each.last_delay - each.first_delay
        for each in facts
        if each.last_delay is not None and each.first_delay is not None
    ]
    most = int(total * _LATE_SHARE)
    own = None if rises else most
    return [
        Figure("telegrams", "telegrams", total, least=0.99 * 2 * _SESSION_S / (sessions[0].cycle_ns * 1e-9)),
        Figure("cycle_ms", "cycle", sessions[0].cycle_ns * 1e-6, "ms"),
        Figure("delay_rise", "rise of Delay, both sessions", sum(rises) if rises else None, most=most),
        Figure("late", "late answers by the clock of this computer", missed["late"], most=own),
        Figure("lost", "lost telegrams", missed["lost"], most=most),
        Figure("skipped", "telegrams without an answer of their own", missed["skipped"], most=most),
        Figure("jitter_ms", "arrival after the fastest, median", median(delays_ms), "ms"),
        Figure("jitter_most_ms", "arrival after the fastest, latest", max(delays_ms), "ms"),
        Figure("first_delay", "Delay of the first telegram that was answered", max(first, default=None)),
        Figure("ports", "UDP ports of the sessions", ", ".join(map(str, ports))),
        Figure("port", "port of the second session", "kept" if ports[0] == ports[1] else "new"),
        Figure("mark", "mark of a session", "session" if 0 not in marks and marks[0] != marks[1] else "none"),
    ]


async def _tenths(robot: WatchedRobot, person: Person) -> list[Figure]:
    await _in_t1(robot, person)
    return await tenths(robot)


async def _stops(robot: WatchedRobot, clock: Clock, person: Person) -> list[Figure]:
    await _in_t1(robot, person)
    stopped = await stops(robot, clock)
    figures = stop_figures(stopped, LONGEST_LAG_S)
    if all(figure.ok for figure in figures if figure.wanted):
        lag_ms = fmean(_lag_ms(each.found, each.stopped_ns) for each in stopped)
        figures.append(Figure("lag_ms", "of that the lag of the axis", lag_ms, "ms"))
    return figures


def _lag_ms(found: SearchResult, stopped_ns: int) -> float:
    """Of A1 behind its set-point, from its way after the telegram that was the first to be answered with the stop."""
    times = found.times_ns
    cycle_ns = min(after - before for before, after in pairwise(times))
    first = next((i for i, time in enumerate(times) if time >= stopped_ns), len(times) - 1)
    way_s = abs(found.resting[0] - found.joints[first][0]) / LINE_DEG_S
    return max(0.0, way_s * 1e3 - _CYCLES_OF_STOP * cycle_ns * 1e-6)
