"""A tenth of a degree on a robot whose corrections are wired to other axes: the step fails, and stops moving."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from cellctl.clock import WallClock
from cellctl.devices import Figure, Health, SearchEnd, SearchResult
from drivers.kuka_rsi.robot.commissioning import steps_of

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)


class Robot:
    """Goes where it is told but for `wired`: axis of the correction → axis that moves, and by how much of it."""

    name, axes = "robot", 6

    def __init__(self, wired: dict[int, tuple[int, float]]) -> None:
        self.wired, self.here, self.searches = wired, HOME, 0

    async def health(self) -> Health:
        return Health(ok=False, text="T1, READY", mode="T1")

    async def joints(self) -> tuple[float, ...]:
        return self.here

    def clear_stop(self) -> None:
        pass

    async def search(self, end: tuple[float, ...], speed: float, guards: Any = None) -> SearchResult:
        self.searches += 1
        here = list(self.here)
        for axis, (a, b) in enumerate(zip(self.here, end, strict=True)):
            moved, share = self.wired.get(axis, (axis, 1.0))
            here[moved] += share * (b - a)
        self.here = tuple(here)
        return SearchResult(SearchEnd.TRAVEL, (), (), self.here, 0, 0, 0, 0)


def tenths(robot: Robot) -> dict[str, Figure]:
    (step,) = (each for each in steps_of(robot, WallClock()) if each.id == "tenth")  # type: ignore[arg-type]
    assert step.moves
    return {figure.name: figure for figure in asyncio.run(step.run(None))}  # type: ignore[arg-type]


def test_every_axis_that_follows_passes():
    robot = Robot({})
    found = tenths(robot)
    assert all(figure.ok for figure in found.values())
    assert robot.searches == 12
    assert robot.here == pytest.approx(HOME)


@pytest.mark.parametrize("wired", [{1: (2, 1.0)}, {1: (1, -1.0)}, {1: (1, 0.0)}, {1: (1, 10.0)}])
def test_an_axis_that_does_not_move_as_it_is_told_fails_and_no_further_one_is_moved(wired):
    robot = Robot(wired)
    found = tenths(robot)
    assert found["a1_deg"].ok
    assert not found["a2_deg"].ok
    assert "a3_deg" not in found
    assert robot.searches == 4
