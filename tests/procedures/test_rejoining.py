"""A robot cut off anywhere on its way goes back along it, and one that was moved off it is not moved."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.devices import DeviceRefused
from procedures.steps.contact_search import last_point_before, rejoin

WAY = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (30.0, 10.0)]


class Robot:
    name = "robot"

    def __init__(self, here: tuple[float, ...]) -> None:
        self.here = here
        self.moves: list[tuple[float, ...]] = []

    async def joints(self) -> tuple[float, ...]:
        return self.here

    async def move(self, target: tuple[float, ...], speed_percent: float) -> tuple[float, ...]:
        self.moves.append(target)
        self.here = target
        return target


def brought_back(here: tuple[float, ...]) -> tuple[int, list[tuple[float, ...]]]:
    robot: Any = Robot(here)
    return asyncio.run(rejoin(robot, WAY, 5.0)), robot.moves


def test_a_robot_that_is_corrected_on_line_is_where_its_program_has_it() -> None:
    robot: Any = Robot((11.2, 6.5))
    assert asyncio.run(rejoin(robot, WAY, 5.0, here=(10.0, 5.0))) == 1
    assert robot.moves == [WAY[1]]


def test_at_the_beginning_nothing_moves() -> None:
    assert brought_back((0.0, 0.1)) == (0, [])


def test_between_two_points_it_goes_back_to_the_one_before() -> None:
    assert brought_back((4.0, 0.2)) == (0, [(0.0, 0.0)])
    assert brought_back((10.1, 6.0)) == (1, [(10.0, 0.0)])


def test_at_a_later_point_it_stays_there() -> None:
    assert brought_back((10.0, 9.9)) == (2, [(10.0, 10.0)])


def test_off_the_way_nothing_moves_and_the_cure_names_a_pose() -> None:
    robot: Any = Robot((20.0, 5.0))
    with pytest.raises(DeviceRefused, match="off its planned way") as refused:
        asyncio.run(rejoin(robot, WAY, 5.0))
    assert robot.moves == []
    assert "0.0, 0.0 deg" in refused.value.cure


@given(st.integers(0, 2), st.floats(0, 1))
def test_from_every_point_of_the_way_the_move_back_stays_on_the_way(line: int, share: float) -> None:
    (a, b), (c, d) = WAY[line], WAY[line + 1]
    here = (a + share * (c - a), b + share * (d - b))
    index = last_point_before(WAY, here)
    assert index is not None
    assert line - 1 <= index <= line + 1
