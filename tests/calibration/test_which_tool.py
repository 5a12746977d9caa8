"""A new tool told by ten touches: the right one is found, or it is said that the touches leave it open."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import RowBlocks, Split, Task, fit, identify
from tests.helpers.own_campaigns import Campaign, certificate, nominal_of
from tests.helpers.simulated_setups import SPHERES

SHIFT_MM = 10.0
TOOL = ("tool_x", "tool_y", "tool_z")


def retooled(seed, spheres, touches=10, shift_mm=SHIFT_MM):
    """A robot that an older model knows with another tool, and the task of finding that."""
    campaign = Campaign.of(seed)
    older = identify(Task(nominal_of(campaign.nominal), campaign.positions(60, 0.05))).identified
    tool = campaign.truth.tool.copy()
    tool[:3, 3] += campaign.rng.normal(0.0, shift_mm, 3)
    campaign = replace(campaign, truth=replace(campaign.truth, tool=tool))
    rows = campaign.touches(touches, SPHERES[2:] if spheres == 1 else SPHERES[:spheres], 0.03)
    robot = older.unknowns.robot
    task = Task(
        older.state.model,
        rows,
        ("S1", "S2", "S3")[:spheres],
        np.full((spheres, 3), np.nan),
        groups=frozenset({"tool"}),
        prior=older.covariance[:robot, :robot],
    )
    return campaign, task


def off_in_sigma(campaign, found):
    """How far the tool found is from the true one, in its own σ."""
    model = found.state.model
    mine = [model.names.index(name) for name in TOOL]
    error = model.deviations[mine] - (np.linalg.inv(np.array(model.chain.tool)) @ campaign.truth.tool)[:3, 3]
    return float(np.sqrt(error @ np.linalg.solve(found.covariance[np.ix_(mine, mine)], error)))


@pytest.mark.parametrize(("spheres", "seed"), [(1, 3), (1, 10), (2, 4), (2, 10), (2, 12), (2, 23), (2, 27), (2, 29)])
def test_where_the_taught_tool_leads_astray_the_right_one_is_found(spheres, seed):
    """Draws in which least squares from where the tool was before ends in another valley and settles there."""
    campaign, task = retooled(seed, spheres)
    found = identify(task)
    assert off_in_sigma(campaign, found.identified) < 4.0
    assert found.noise.max() < 1.5
    assert not found.outliers


@pytest.mark.parametrize("seed", [3, 11])
def test_a_tool_that_is_decimetres_longer_is_found_too(seed):
    campaign, task = retooled(seed, 2, touches=14, shift_mm=150.0)
    found = identify(task).identified
    assert off_in_sigma(campaign, found) < 4.0
    assert found.converged


def test_two_tools_that_explain_the_touches_alike_are_not_decided_between():
    """Five touches on each of two spheres: ten numbers for nine; two tools are 3.4 mm apart, σ of either is 0.8."""
    campaign, task = retooled(17, 2)
    found = identify(task).identified
    assert not found.converged
    assert "leave open which tool" in found.ended
    assert off_in_sigma(campaign, found) < 4.0


@pytest.mark.parametrize("seed", [5, 17])
def test_the_certified_distance_of_two_spheres_decides_between_tools_that_the_touches_leave_open(seed):
    campaign, task = retooled(seed, 2)
    assert "leave open which tool" in identify(task).identified.ended
    spacing = certificate(campaign.rng, np.array(SPHERES[:2]), [(0, 1)], 0.01)
    found = identify(replace(task, spacings=spacing)).identified
    assert found.converged
    assert off_in_sigma(campaign, found) < 4.0


def test_touches_too_few_for_tool_and_spheres_are_called_too_few():
    _, task = retooled(1, 3)
    found = identify(task).identified
    assert not found.converged
    assert "10 distances" in found.ended
    assert "3 more at least" in found.ended
    _, task = retooled(1, 3, touches=18)
    assert identify(task).identified.converged


@pytest.mark.parametrize(("spheres", "touches"), [(1, 1), (1, 2), (3, 3)])
def test_a_touch_or_two_are_too_few_and_said_to_be(spheres, touches):
    """Each point begins where the tip is, with no direction in which it could go."""
    _, task = retooled(1, spheres, touches=12)
    task = replace(task, rows=task.rows.pick(np.arange(touches)))
    found = identify(task).identified
    assert not found.converged
    assert f"{touches} distance" in found.ended


def test_sockets_tell_a_new_tool_without_a_search():
    campaign, task = retooled(1, 1)
    visits = campaign.sockets(12, SPHERES[:1], 0.03)
    found = identify(replace(task, rows=RowBlocks.of(visits))).identified
    assert found.converged
    assert off_in_sigma(campaign, found) < 4.0


@pytest.mark.long
def test_touches_that_contradict_each_other_prove_no_new_tool_however_far_the_older_one_is_off():
    _, task = retooled(2, 1, touches=12, shift_mm=300.0)
    rows = task.rows.only
    wrong = replace(task, rows=replace(rows, reach=rows.reach + np.where(np.arange(12) % 2, 1.0, -1.0)))
    result = fit(wrong, Split.folds(12, 4, 0))
    assert result.verdict == "no better"
    assert "do not fit together" in result.verdict_reason
