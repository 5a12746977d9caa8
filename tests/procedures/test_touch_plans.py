"""How early on its line a contact can still be one with the sphere."""

from __future__ import annotations

from typing import Any

import pytest

from procedures.steps.sphere.touch_plans import StandOffPlan, TouchPlan

WAY: dict[str, Any] = {
    "number": 1,
    "sphere": "P1",
    "origin": [0.0],
    "approach": [],
    "end": [1.0],
    "search_mm": 18.0,
    "retreat": [],
}


def stand_off(expected_mm: float, distance_mm: float = 10.0) -> StandOffPlan:
    return StandOffPlan(
        **WAY,
        run="before",
        row=None,
        nominal=[0.0],
        commanded=[0.0],
        normal=[0.0, 0.0, 1.0],
        distance_mm=distance_mm,
        expected_mm=expected_mm,
        sigma_mm=0.1,
    )


def test_a_touch_in_the_first_tenth_of_its_line_is_too_early() -> None:
    assert TouchPlan(**WAY, set="fit", start=[0.0]).earliest_mm == pytest.approx(1.8)


def test_a_stand_off_may_come_as_early_as_the_model_foresees_of_the_nominal_robot_and_little_earlier() -> None:
    assert stand_off(0.0).earliest_mm == pytest.approx(6.0)
    assert stand_off(-5.0).earliest_mm == pytest.approx(1.0)


def test_without_any_way_there_is_no_contact_whatever_is_predicted() -> None:
    assert stand_off(-9.0).earliest_mm == pytest.approx(0.5)
    assert stand_off(0.0, distance_mm=2.0).earliest_mm == pytest.approx(0.5)
