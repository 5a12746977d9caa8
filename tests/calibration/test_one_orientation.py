"""Rows that all have one orientation do not tell a tool from a base; what little they say of it is not believed."""

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cellctl.calibration import PositionRows, Split, Task, fit
from tests.helpers.own_campaigns import Campaign, nominal_of


def rows_within(campaign, spread_deg, count=20):
    """Positions (`count`, 0.03 mm) whose tools, by the nominal robot, are turned by `spread_deg` at most."""
    model, rng = nominal_of(campaign.nominal), campaign.rng
    chain = model.chain.with_base(np.eye(4))
    upright = chain.forward_flange(np.deg2rad([[0.0, -70.0, 80.0, 0.0, 80.0, 0.0]]))[0]
    found = []
    while len(found) < count:
        place = upright[:3, 3] + rng.uniform(-1, 1, 3) * [150.0, 300.0, 150.0]
        turn = upright[:3, :3] @ Rotation.from_rotvec(np.deg2rad(spread_deg) * rng.uniform(-1, 1, 3)).as_matrix()

        def away(q, place=place, turn=turn):
            flange = chain.forward_flange(q[None])[0]
            return np.r_[flange[:3, 3] - place, 500 * Rotation.from_matrix(flange[:3, :3].T @ turn).as_rotvec()]

        solved = least_squares(away, np.deg2rad([0.0, -70.0, 80.0, 0.0, 80.0, 0.0]))
        if solved.cost < 1e-6:
            found.append(solved.x)
    q = np.array(found)
    xyz = campaign.truth.points(q) + rng.normal(0.0, 0.03, (count, 3))
    return PositionRows(q, xyz, np.full((count, 3), 0.03))


def freed(seed, spread_deg):
    """Base and tool found from such rows, the links held; and where the tool truly is, mm."""
    campaign = Campaign.of(seed)
    task = Task(nominal_of(campaign.nominal), rows_within(campaign, spread_deg), groups=frozenset({"base", "tool"}))
    return fit(task, Split.folds(20, 3, 0)), campaign


@pytest.mark.parametrize("spread_deg", [0.05, 0.1])
def test_the_tool_is_named_as_unobservable_and_does_not_move(spread_deg):
    result, campaign = freed(1, spread_deg)
    found = result.identification.identified
    assert found.converged
    assert result.observability.rank == result.n_parameters - 3
    (hidden,) = result.observability.hidden
    assert hidden.reason == "orientation never changes in these rows"
    assert "tool translation along Z" in " ".join(hidden.phrases())
    taught = campaign.nominal.tool[:3, 3]
    assert np.linalg.norm(found.state.model.chain.tool_now[:3, 3] - taught) < 5.0
    sigma = np.sqrt(np.diag(found.covariance))[[found.unknowns.names.index(f"tool_{axis}") for axis in "xyz"]]
    assert sigma.min() > 100.0


def test_orientations_that_differ_by_degrees_tell_the_tool():
    result, campaign = freed(1, 5.0)
    found = result.identification.identified
    assert result.observability.rank == result.n_parameters
    assert np.linalg.norm(found.state.model.chain.tool_now[:3, 3] - campaign.truth.tool[:3, 3]) < 5.0
