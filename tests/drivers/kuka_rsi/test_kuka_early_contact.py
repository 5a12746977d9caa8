"""A probe that speaks before the robot moves on its line: nothing moves, and the touch can be tried again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from cellctl.devices import Contact, NoContact
from procedures.steps.contact_search import Speeds, search_and_retreat

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
END = (0.0, -88.0, 90.0, 0.0, 45.0, 0.0)


@dataclass
class Way:
    sphere: str = "S1"
    origin: tuple[float, ...] = HOME
    start: tuple[float, ...] = HOME
    approach: list[tuple[float, ...]] = field(default_factory=list)
    end: tuple[float, ...] = END
    search_mm: float = 20.0
    earliest_mm: float = 1.0
    retreat: list[tuple[float, ...]] = field(default_factory=lambda: [HOME])


@dataclass
class EagerProbe:
    """Says an edge as soon as it is armed, where it `trips`; `contacts`: times of edges, ns of the cell."""

    controller: object
    trips: bool = True
    contacts: list[int] = field(default_factory=list)
    armed: bool = False

    async def arm(self, on_edge: Callable[[], None], on_alive: Callable[[int], None]) -> None:
        self.armed = True
        if self.trips:
            self.contacts.append(self.controller.now_ns)
            on_edge()

    async def contact(self) -> Contact:
        return Contact(self.contacts[-1], 1000, 7, True, 0)

    async def touching(self) -> bool:
        return self.armed  # in the search, and no longer once the robot is back

    async def disarm(self) -> None:
        self.armed = False


async def touched(robot, probe, way=None):
    """The contact that was recorded."""
    recorded = []

    async def to_start():
        return await robot.move(HOME, 50.0)

    async def record(found):
        recorded.append(found)

    await search_and_retreat(robot, probe, way or Way(), to_start, Speeds(10.0, 50.0), record)
    return recorded[0]


def test_an_edge_between_arming_and_the_search_moves_nothing_and_is_no_contact(controller, connected, run):
    async def touch():
        async with connected() as robot:
            probe = EagerProbe(controller)
            with pytest.raises(NoContact, match="before the robot moved"):
                await touched(robot, probe)

    run(touch())
    assert {answer.correction for answer in controller.answers} == {(0,) * 6}
    assert controller.answers
    assert not controller.in_rsi


def test_an_edge_while_the_robot_still_stands_in_the_search_is_no_contact(controller, connected, run):
    async def touch():
        async with connected() as robot:
            probe = EagerProbe(controller, trips=False)

            def trip(cycle: int) -> None:
                if cycle == 4:
                    probe.contacts.append(controller.now_ns)
                    robot.stop_now()

            controller.on_cycle = trip
            with pytest.raises(NoContact, match="before the robot moved"):
                await touched(robot, probe)

    run(touch())
    assert {answer.correction for answer in controller.answers} == {(0,) * 6}


def test_the_touch_after_an_early_edge_finds_its_contact(controller, connected, run):
    async def touch():
        async with connected() as robot:
            probe = EagerProbe(controller)
            with pytest.raises(NoContact):
                await touched(robot, probe)
            probe.trips = False

            def trip(cycle: int) -> None:
                if cycle == 200:
                    probe.contacts.append(controller.now_ns)
                    robot.stop_now()

            controller.on_cycle = trip
            return await touched(robot, beating(robot, probe, controller))

    found = run(touch())
    assert -90 < found.joints[1] < -88
    assert found.contact.confirmed


def beating(robot, probe, controller):
    """The probe's heartbeat, left at each cycle as its own thread would."""
    guard, before = robot.guard("probe"), controller.on_cycle

    def beat(cycle: int) -> None:
        guard.beat(controller.now_ns)
        before(cycle)

    controller.on_cycle = beat
    return probe
