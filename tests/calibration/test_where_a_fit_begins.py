"""Where a fit begins: from nominal and the rows alone it finds its valley, however far off the tool is said to be."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import Task, TouchRows, identify
from cellctl.calibration.problem.registration import fixed_points
from cellctl.calibration.rows.fixed_points import sphere_centre
from tests.helpers.own_campaigns import Campaign, nominal_of


@pytest.mark.parametrize("seed", range(6))
def test_a_tool_two_metres_from_where_the_robot_file_has_it_is_found_in_twelve_positions(seed):
    campaign = Campaign.of(seed)
    away = campaign.rng.normal(size=3)
    tool = campaign.truth.tool.copy()
    tool[:3, 3] += 2100.0 * away / np.linalg.norm(away)
    rows = replace(campaign, truth=replace(campaign.truth, tool=tool)).positions(12, 0.05)
    found = identify(Task(nominal_of(campaign.nominal), rows))
    assert found.identified.converged
    assert found.noise.max() < 1.5
    assert np.linalg.norm(found.identified.state.model.chain.tool_now[:3, 3] - tool[:3, 3]) < 20.0


@pytest.mark.parametrize("half_angle_deg", [15.0, 40.0, 90.0])
def test_touches_on_a_small_cap_find_the_sphere_on_the_side_where_it_is(half_angle_deg):
    """The linear problem alone does not know the radius, and mistakes a noisy cap for that of a small sphere."""
    rng = np.random.default_rng(3)
    centre, reach = np.array([900.0, -200.0, 300.0]), 31.3
    for _ in range(20):
        around = rng.uniform(0.0, 2.0 * np.pi, 8)
        tilt = np.radians(half_angle_deg) * np.sqrt(rng.uniform(0.0, 1.0, 8))
        away = np.stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], axis=1)
        tips = centre + (reach + rng.normal(0.0, 0.05, (8, 1))) * away
        assert np.linalg.norm(sphere_centre(tips, np.full(8, reach)) - centre) < 5.0


def test_a_point_without_a_known_place_and_without_a_row_begins_in_the_middle_of_the_tcps():
    campaign = Campaign.of(1)
    model = nominal_of(campaign.nominal)
    q = campaign.asked(8)
    rows = TouchRows(q, np.zeros(8, int), np.full(8, 500.0), np.full((8, 1), 0.05))
    known = np.array([900.0, 0.0, 300.0])
    begun = fixed_points([model], [rows], np.stack([known, np.full(3, np.nan)]))
    np.testing.assert_allclose(begun, np.stack([known, model.tcp(q).mean(axis=0)]))
