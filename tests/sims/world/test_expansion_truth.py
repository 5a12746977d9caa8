"""Links that grow with temperature: against a link table whose lengths have grown."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sims.conditions import Conditions
from sims.world.environment import expansions
from tests.helpers.sims import BENT, CELL, world

READINGS = st.tuples(*[st.floats(joint.min, joint.max) for joint in CELL.robot.joints])
STRETCHED = (0.0,) * 6


@given(READINGS, st.floats(-10.0, 60.0))
@settings(max_examples=30)
def test_at_a_temperature_the_robot_is_one_with_longer_links_and_the_same_tool(readings, temperature):
    rates = expansions(6, 1, 1.0)
    rows = [
        replace(link, a=link.a * (1 + rate * (temperature - 20)), d=link.d * (1 + rate * (temperature - 20)))
        for link, rate in zip(CELL.robot.links, rates, strict=True)
    ]
    longer = world(cell=replace(CELL, robot=replace(CELL.robot, links=tuple(rows))))
    warm = world(expansion=1).true_tcp(readings, Conditions(temperature_c=temperature))
    assert warm == pytest.approx(longer.true_tcp(readings), abs=1e-8)


def test_links_are_of_something_between_steel_and_aluminium():
    drawn = [rate for seed in range(1, 40) for rate in expansions(6, seed, 1.0)]
    assert 1.2e-5 <= min(drawn) < 1.3e-5
    assert 2.2e-5 < max(drawn) <= 2.3e-5


def test_ten_kelvin_lengthen_the_stretched_arm_by_the_order_of_a_quarter_of_a_millimetre():
    for seed in range(1, 10):
        cold, warm = (world(seed, expansion=1).true_tcp(STRETCHED, Conditions(temperature_c=t)) for t in (20.0, 30.0))
        assert 0.17 < np.linalg.norm(np.subtract(warm, cold)) < 0.36


def test_at_twenty_degrees_or_without_expansion_temperature_changes_nothing():
    assert world(expansion=1).true_tcp(BENT) == world().true_tcp(BENT)
    assert world().true_tcp(BENT, Conditions(temperature_c=50.0)) == pytest.approx(world().true_tcp(BENT), abs=1e-12)
