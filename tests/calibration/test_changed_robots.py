"""An update of an older model by rows of a robot that has changed since, and nobody said so; over many robots."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

from cellctl.calibration import Identification, RowBlocks, Split, Task, fit, identify
from tests.helpers.honesty import squared
from tests.helpers.own_campaigns import Campaign, nominal_of
from tests.helpers.own_model import Floats

SIGMA = 0.03
ROBOTS = 8
CHANGES = {
    "A3 by 0.05°": ("zeros", "theta3", np.radians(0.05)),
    "A3 by 0.3°": ("zeros", "theta3", np.radians(0.3)),
    "a link by 1 mm": ("links", "a2", 1.0),
}


@cache
def before(seed):
    """A robot, and the model of it that 80 positions gave."""
    campaign = Campaign.of(seed)
    return campaign, identify(Task(nominal_of(campaign.nominal), campaign.positions(80, SIGMA))).identified


@dataclass(frozen=True)
class Updated:
    """A robot that may have changed, and what 40 rows made of the older model. asked (M, n): other joint angles."""

    campaign: Campaign
    task: Task
    done: Identification
    asked: Floats

    @classmethod
    def of(cls, seed, name=None, by=0.0, noise=1.0):
        campaign, older = before(seed)
        truth = campaign.truth if name is None else campaign.truth.moved((name,), [by])
        later = replace(campaign, truth=truth, rng=np.random.default_rng([seed, 12]))
        robot = older.unknowns.robot
        rows = later.positions(40, noise * SIGMA, said=SIGMA)
        task = Task(older.state.model, rows, prior=older.covariance[:robot, :robot])
        return cls(later, task, identify(task), later.asked())

    @property
    def errors(self):
        """Of predicted points (M, 3), mm."""
        return self.done.identified.state.model.tcp(self.asked) - self.campaign.truth.points(self.asked)

    @property
    def nees(self):
        """Of predicted points, per degree of freedom."""
        best = self.done.identified
        robot = best.unknowns.robot
        columns, covariance = best.state.model.jacobian(self.asked)[:, :3], best.covariance[:robot, :robot]
        each = [squared(e, c @ covariance @ c.T) for e, c in zip(self.errors, columns, strict=True)]
        return float(np.mean(each) / 3.0)


@pytest.fixture(scope="module")
def unchanged():
    return [Updated.of(seed) for seed in range(ROBOTS)]


@pytest.fixture(scope="module", params=CHANGES.values(), ids=list(CHANGES))
def changed(request):
    """The group that changed, and the updates."""
    group, name, by = request.param
    return group, [Updated.of(seed, name, by) for seed in range(ROBOTS)]


def rms(all_of):
    return float(np.sqrt(np.mean([np.sum(one.errors**2, axis=1) for one in all_of])))


def test_a_robot_that_is_what_it_was_is_called_neither_changed_nor_noisy(unchanged):
    assert not any(one.done.prior_scale for one in unchanged)
    assert max(one.done.noise.max() for one in unchanged) == 1.0


def test_a_robot_that_has_changed_is_found_and_what_changed_is_named(changed, unchanged):
    """No noise is made of it, and nothing but what changed has to be found once more."""
    group, found = changed
    for one in found:
        assert list(one.done.prior_scale) == [group]
        assert one.done.prior_scale[group] > 5.0
        assert one.done.noise.max() == 1.0
        assert not one.done.outliers
        assert one.done.identified.converged
    assert rms(found) < 2.0 * rms(unchanged)


def test_the_model_of_a_changed_robot_is_as_sure_as_it_says(changed):
    _, found = changed
    assert np.mean([one.nees for one in found]) == pytest.approx(1.0, abs=0.35)


@pytest.mark.long
def test_an_update_of_a_changed_robot_is_better_than_its_older_model():
    updated = Updated.of(0, "theta3", np.radians(0.1))
    assert fit(updated.task, Split.folds(40, 5, 0)).verdict == "better"


def test_noisier_rows_of_the_same_robot_are_called_noisier_and_the_robot_is_not_called_changed():
    for one in (Updated.of(seed, noise=3.0) for seed in range(4)):
        assert not one.done.prior_scale
        assert one.done.noise.max() == pytest.approx(3.0, rel=0.3)


def test_wild_rows_are_found_on_a_robot_that_has_changed_as_well():
    updated = Updated.of(1, "theta3", np.radians(0.1))
    rows = updated.task.rows.only
    xyz = rows.xyz.copy()
    xyz[[3, 17, 30]] += [[1.0, -1.0, 0.5], [0.0, 2.0, 0.0], [-1.0, 0.5, 1.0]]
    done = identify(replace(updated.task, rows=RowBlocks.of(replace(rows, xyz=xyz))))
    assert done.outliers == (3, 17, 30)
    assert list(done.prior_scale) == ["zeros"]
