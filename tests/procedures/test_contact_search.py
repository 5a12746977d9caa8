"""What counts as a contact with the sphere, when it is recorded, and what is asked of the probe before and after."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import pytest

from cellctl.devices import Contact, DeviceFault, DeviceLost, NoContact, ProbeNotOpen, SearchEnd, SearchResult
from procedures.steps.contact_search import FoundContact, Speeds, search_and_retreat

HOME, CLEAR, START, END = (0.0,), (10.0,), (20.0,), (38.0,)
MS = 1_000_000
WIRE = DeviceFault("probe", "the loop is broken (fault WIRE)", "check the leads")


@dataclass
class Way:
    sphere: str = "S1"
    origin: tuple[float, ...] = HOME
    approach: tuple[tuple[float, ...], ...] = (CLEAR,)
    start: tuple[float, ...] = START
    end: tuple[float, ...] = END
    search_mm: float = 18.0
    earliest_mm: float = 3.6
    retreat: tuple[tuple[float, ...], ...] = (START, CLEAR)


class Guard:
    def beat(self, time_ns: int) -> None:
        pass


@dataclass
class Robot:
    """Searches one degree (a millimetre) a second, to `stops_at`; `log` says what happened in which order."""

    log: list[str]
    stops_at: float | None = 30.0
    lost_on_retreat: bool = False
    here: tuple[float, ...] = HOME
    name: str = "robot"

    async def joints(self) -> tuple[float, ...]:
        return self.here

    async def move(self, target: tuple[float, ...], _: float) -> tuple[float, ...]:
        if self.lost_on_retreat and "search" in self.log:
            raise DeviceLost("robot", "the EKI channel is gone", "look at the cable")
        self.log.append(f"move {target[0]:g}")
        self.here = target
        return target

    def guard(self, _: str) -> Guard:
        return Guard()

    def clear_stop(self) -> None:
        pass

    def stop_now(self) -> None:
        pass

    async def search(self, end: tuple[float, ...], *_: object) -> SearchResult:
        self.log.append("search")
        last = end[0] if self.stops_at is None else self.stops_at + 0.2
        times = [round((a - START[0]) * 1000) * MS for a in (START[0], last)]
        self.here = (last,)
        ended = SearchEnd.TRAVEL if self.stops_at is None else SearchEnd.STOPPED
        return searched(ended, times, [START, (last,)])


@dataclass
class Probe:
    """`confirmed` of the contact at `at`; `pressed`: closed at rest; `stuck`: closed when the robot is back, too."""

    log: list[str]
    at: float = 30.0
    confirmed: bool | None = True
    pressed: bool = True
    stuck: bool = False
    fault: DeviceFault | None = None
    armed: bool = False

    async def arm(self, on_edge: Callable[[], None], on_alive: Callable[[int], None]) -> None:
        self.armed = True

    async def contact(self) -> Contact:
        return Contact(round((self.at - START[0]) * 1000) * MS, 1000, 7, self.confirmed, 0)

    async def touching(self) -> bool:
        if self.fault:
            raise self.fault
        return self.pressed if self.armed else self.stuck

    async def disarm(self) -> None:
        self.armed = False


@dataclass
class Bench:
    log: list[str] = field(default_factory=list)
    recorded: list[FoundContact] = field(default_factory=list)

    def touch(self, robot: dict[str, object] | None = None, other: Way | None = None, **probe: object) -> None:
        arm, tip = Robot(self.log, **(robot or {})), Probe(self.log, **probe)

        async def after_miss() -> Way | None:
            self.log.append("missed")
            arm.stops_at = tip.at
            return other

        async def record(found: FoundContact) -> None:
            self.log.append("record")
            self.recorded.append(found)

        to_start = partial(arm.move, START, 5.0)
        asyncio.run(search_and_retreat(arm, tip, Way(), to_start, Speeds(5.0, 20.0), record, after_miss))


def searched(end: SearchEnd, times: list[int], joints: list[tuple[float, ...]]) -> SearchResult:
    return SearchResult(
        end=end,
        times_ns=tuple(times),
        joints=tuple(joints),
        resting=joints[-1],
        stop_cycles=1,
        late=0,
        lost=0,
        skipped=0,
    )


def test_a_contact_that_holds_is_recorded_before_the_robot_moves_away() -> None:
    bench = Bench()
    bench.touch()
    assert bench.log == ["move 10", "move 20", "search", "record", "move 20", "move 10"]
    assert bench.recorded[0].joints == pytest.approx((30.0,))


def test_a_robot_that_is_lost_on_the_retreat_leaves_the_contact_recorded() -> None:
    bench = Bench()
    with pytest.raises(DeviceLost):
        bench.touch({"lost_on_retreat": True})
    assert len(bench.recorded) == 1


@pytest.mark.parametrize(
    ("probe", "robot", "says"),
    [
        ({"pressed": False}, {}, "for a moment only"),
        ({"confirmed": False}, {}, "did not hold"),
        ({"confirmed": None}, {}, "did not report"),
        ({"at": 23.0}, {"stops_at": 23.0}, "something else was touched"),
        ({}, {"stops_at": None}, "no contact on S1 within 18 mm"),
    ],
)
def test_what_is_no_contact_with_the_sphere_is_not_recorded_and_can_be_tried_again(probe, robot, says) -> None:
    bench = Bench()
    with pytest.raises(NoContact, match=says):
        bench.touch(robot, **probe)
    assert bench.recorded == []
    assert [each for each in bench.log if each != "missed"][-2:] == ["move 20", "move 10"], "the robot is back"


def test_a_line_without_contact_is_followed_by_another_one_if_there_is_any() -> None:
    deeper = Way(origin=CLEAR, approach=((11.0,),), start=(26.0,), end=(44.0,), retreat=((26.0,), (11.0,), CLEAR))
    bench = Bench()
    bench.touch({"stops_at": None}, deeper, at=40.0)
    before = ["move 10", "move 20", "search", "move 20", "move 10"]
    again = ["move 11", "move 26", "search", "record", "move 26", "move 11", "move 10"]
    assert bench.log == [*before, "missed", *again]
    assert bench.recorded[0].joints == pytest.approx((40.0,))


def test_a_contact_that_is_none_of_the_sphere_is_not_followed_by_another_line() -> None:
    bench = Bench()
    with pytest.raises(NoContact, match="did not hold"):
        bench.touch(other=Way(), confirmed=False)
    assert "missed" not in bench.log


def test_silence_about_a_contact_points_to_the_line_and_a_bounce_to_the_tip() -> None:
    with pytest.raises(NoContact) as silence:
        Bench().touch(confirmed=None)
    with pytest.raises(NoContact) as bounce:
        Bench().touch(confirmed=False)
    assert "serial line" in str(silence.value)
    assert "tip" not in str(silence.value)
    assert "tip" in str(bounce.value)


def test_a_fault_that_the_probe_knows_of_at_the_end_of_the_travel_is_what_is_reported() -> None:
    bench = Bench()
    with pytest.raises(DeviceFault, match="WIRE"):
        bench.touch({"stops_at": None}, fault=WIRE)
    assert bench.recorded == []


def test_a_loop_that_stays_closed_once_the_robot_is_back_was_no_contact() -> None:
    with pytest.raises(ProbeNotOpen, match="still closed"):
        Bench().touch(stuck=True)
