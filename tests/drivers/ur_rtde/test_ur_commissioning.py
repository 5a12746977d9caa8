"""Steps of a UR's commissioning on a robot without wires: what fails is named."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from cellctl.clock import WallClock
from cellctl.devices import DeviceFault
from drivers.ur_rtde.commissioning import steps_of


class Robot:
    """Its contact input shows `states`, one for each question."""

    name, axes = "robot", 6

    def __init__(self, states: list[bool]) -> None:
        self.states = states

    async def contact_seen(self, *, closed: bool, limit_s: float) -> bool:
        return self.states.pop(0) is closed


class Person:
    def __init__(self) -> None:
        self.asked_for: list[str] = []

    async def told(self, text: str, device: str, action: str) -> None:
        self.asked_for.append(text)


def wire(states: list[bool]) -> tuple[Any, Person]:
    robot: Any = Robot(states)
    person: Any = Person()
    (step,) = (each for each in steps_of(robot, WallClock(), 3) if each.id == "wire")
    assert "input 3" in step.does
    return asyncio.run(step.run(person)), person


def test_a_wire_that_follows_three_times_passes():
    figures, person = wire([True, False] * 3)
    assert all(figure.ok for figure in figures)
    assert len(person.asked_for) == 3


@pytest.mark.parametrize(("states", "words"), [([False], "was not closed"), ([True, True], "was not open again")])
def test_an_input_that_does_not_follow_is_named(states, words):
    with pytest.raises(DeviceFault, match=words):
        wire(states)


def test_without_a_contact_input_nobody_is_asked_for_the_wire():
    robot: Any = Robot([])
    assert [step.id for step in steps_of(robot, WallClock(), None)] == ["data", "tenth", "stop"]
