"""An older model as the prior: updated, after a crash, with a new tool, at a new place; counted over many robots."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from cellctl.calibration import Estimate, PositionRows, Session, Task, identify, predict
from cellctl.calibration.identification.moved import zero_changes
from tests.helpers.own_campaigns import Campaign, nominal_of, place
from tests.helpers.own_model import Floats, six_of

SIGMA = 0.05
ROBOTS = 24
ZEROS = tuple(f"theta{joint}" for joint in range(1, 7))
LOST_RAD = np.radians(2.0)


@dataclass(frozen=True)
class Older:
    """A robot, what it was measured by before anything happened, and the model made of that."""

    campaign: Campaign
    rows: PositionRows
    found: Estimate

    @classmethod
    def of(cls, seed, count=60):
        campaign = Campaign.of(seed)
        rows = campaign.positions(count, SIGMA)
        return cls(campaign, rows, identify(Task(nominal_of(campaign.nominal), rows)).identified)

    @property
    def covariance(self) -> Floats:
        robot = self.found.unknowns.robot
        return self.found.covariance[:robot, :robot]

    def after(self, **changed):
        """The same robot, something about it changed."""
        return replace(self, campaign=replace(self.campaign, truth=replace(self.campaign.truth, **changed)))

    def crashed(self):
        """The robot with every joint's zero lost by up to 2°, and by how much."""
        lost = self.campaign.rng.uniform(-LOST_RAD, LOST_RAD, 6)
        return replace(self, campaign=replace(self.campaign, truth=self.campaign.truth.moved(ZEROS, lost))), lost

    def task(self, rows, *groups, **more):
        freed = frozenset(groups) or None
        return Task(self.found.state.model, rows, groups=freed, prior=self.covariance, **more)


@pytest.fixture(scope="module")
def olders():
    return [Older.of(seed) for seed in range(ROBOTS)]


def part(found, names):
    """Values and covariance of some of the robot's parameters."""
    model = found.state.model
    mine = [model.names.index(name) for name in names]
    return model.deviations[mine], found.covariance[np.ix_(mine, mine)]


def squared(error, covariance):
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


def as_foretold(per_freedom, freedom):
    """Whether squared errors in σ are 1 on average, to 3 σ of what chance allows in so many numbers."""
    return abs(np.mean(per_freedom) - 1.0) < 3.0 * np.sqrt(2.0 / (freedom * len(per_freedom)))


@pytest.mark.parametrize("seed", range(4))
def test_an_update_with_further_rows_is_the_fit_of_all_of_them(olders, seed):
    """Instrument and target are set up anew for the further rows, as nobody says that they are not."""
    older = olders[seed]
    more, asked = older.campaign.positions(40, SIGMA), older.campaign.asked()
    updated = identify(older.task(more)).identified
    own = Session("later", frozenset({"base", "tool"}))
    task = Task(nominal_of(older.campaign.nominal), [older.rows, replace(more, session=1)], sessions=(Session(), own))
    both = identify(task).identified
    columns, robot = both.state.columns[1], updated.unknowns.robot
    whole = predict(both.state.models[1], both.covariance[np.ix_(columns, columns)], asked)
    ours = predict(updated.state.model, updated.covariance[:robot, :robot], asked)
    off = np.linalg.norm(ours.poses[:, :3, 3] - whole.poses[:, :3, 3], axis=1)
    assert np.all(off < 0.01 * whole.sigma_mm)
    np.testing.assert_allclose(ours.sigma_mm, whole.sigma_mm, rtol=0.01)


@pytest.fixture(scope="module", params=[10, 20])
def crashes(request, olders):
    """After each crash: the lost angles, the task, and what was found from 10 or 20 positions."""
    found = []
    for older in olders:
        crashed, lost = older.crashed()
        task = crashed.task(crashed.campaign.positions(request.param, SIGMA), "zeros")
        found.append((crashed, lost, task, identify(task)))
    return found


def test_zeros_lost_in_a_crash_are_found_as_surely_as_said(crashes):
    nees = []
    for crashed, _, _, done in crashes:
        values, covariance = part(done.identified, ZEROS)
        true = crashed.campaign.truth.table[:, 0] - crashed.campaign.nominal.table[:, 0]
        nees.append(squared(values - true, covariance))
        assert done.identified.converged
        assert not done.outliers
    assert as_foretold(nees, 6)


def test_what_a_zero_has_moved_by_is_found_as_surely_as_said_and_far_surer_than_it_was_lost(crashes):
    squares = []
    for _, lost, task, done in crashes:
        change, sigma = zero_changes(task, done.identified)
        squares.append(np.mean(((change - lost) / sigma) ** 2))
        assert np.all(sigma < 0.02 * LOST_RAD)
    assert as_foretold(squares, 4)  # six numbers, some of them alike


def test_the_older_model_holds_again_once_its_zeros_are_found(crashes):
    said, true = [], []
    for crashed, _, _, done in crashes:
        asked, robot = crashed.campaign.asked(), done.identified.unknowns.robot
        told = predict(done.identified.state.model, done.identified.covariance[:robot, :robot], asked)
        error = told.poses[:, :3, 3] - crashed.campaign.truth.points(asked)
        said.append(np.mean(told.sigma_mm**2))
        true.append(np.mean(np.sum(error**2, axis=1)))
    assert 0.75 < np.sqrt(np.mean(true) / np.mean(said)) < 1.25
    assert np.sqrt(np.mean(true)) < 0.1


def test_what_a_poor_older_model_did_not_know_is_not_taken_for_noise_of_the_rows():
    """Of 25 positions; their errors, held, are as large as the new rows' noise."""
    for seed in range(8, 20):
        crashed, _ = Older.of(seed, count=25).crashed()
        task = crashed.task(crashed.campaign.positions(20, SIGMA), "zeros")
        assert identify(task).noise.max() == 1.0


def test_rows_after_a_crash_that_are_noisier_than_they_say_are_found_to_be(olders):
    for older in olders[:4]:
        crashed, _ = older.crashed()
        rows = crashed.campaign.positions(20, 3.0 * SIGMA, said=SIGMA)
        assert identify(crashed.task(rows, "zeros")).noise.max() == pytest.approx(3.0, rel=0.4)


def test_all_but_the_zeros_stays_as_it_was(crashes):
    _, _, task, done = crashes[0]
    before, after = task.model.deviations, done.identified.state.model.deviations
    moved = {name for name, a, b in zip(task.model.names, before, after, strict=True) if a != b}
    assert moved == set(ZEROS)


def sigma_of_changes(task):
    """1 σ of what each zero has moved by, for rows as good as they say."""
    done = identify(task)
    return zero_changes(task, done.identified)[1] / done.noise.max()


def test_what_the_older_model_was_unsure_of_is_carried_over(olders):
    """Taken to be exact, its errors are noise to the evidence; so σ is compared for rows as good as they say."""
    for seed in range(3):
        poor, good = Older.of(seed, count=25), olders[seed]
        lost = np.radians([0.5, -1.0, 1.5, 0.3, -0.8, 2.0])
        truth = good.campaign.truth.moved(ZEROS, lost)
        rows = replace(good.campaign, truth=truth).positions(20, SIGMA)
        exact = Task(good.found.state.model, rows, groups=frozenset({"zeros"}), prior=1e-8 * good.covariance)
        tasks = exact, good.task(rows, "zeros"), poor.task(rows, "zeros")
        sigmas = [sigma_of_changes(task) for task in tasks]
        assert np.all(sigmas[0] < sigmas[1])
        assert np.sqrt(np.mean(sigmas[1] ** 2)) < np.sqrt(np.mean(sigmas[2] ** 2))


def test_a_robot_set_up_anew_is_found_in_ten_positions_as_surely_as_said(olders):
    nees = []
    for older in olders:
        moved = older.after(base=place(older.campaign.rng))
        found = identify(moved.task(moved.campaign.positions(10, SIGMA), "base")).identified
        names = [f"base_{letter}" for letter in "xyzabc"]
        values, covariance = part(found, names)
        start = np.linalg.inv(np.array(found.state.model.chain.base))
        nees.append(squared(values - six_of(start @ moved.campaign.truth.base), covariance))
    assert as_foretold(nees, 6)


def retooled(older, shift_mm):
    tool = older.campaign.truth.tool.copy()
    tool[:3, 3] += older.campaign.rng.normal(0.0, shift_mm, 3)
    return older.after(tool=tool)


def nees_of_tool(found, truth):
    values, covariance = part(found, ["tool_x", "tool_y", "tool_z"])
    start = np.linalg.inv(np.array(found.state.model.chain.tool))
    return squared(values - (start @ truth.tool)[:3, 3], covariance)


def test_a_new_tool_is_found_in_ten_positions_as_surely_as_said(olders):
    nees = []
    for older in olders:
        after = retooled(older, 100.0)
        found = identify(after.task(after.campaign.positions(10, SIGMA), "tool")).identified
        nees.append(nees_of_tool(found, after.campaign.truth))
    assert as_foretold(nees, 3)


@pytest.mark.long
def test_a_tool_that_has_been_bent_is_found_in_ten_touches_as_surely_as_said(olders):
    nees = []
    for older in olders:
        after = retooled(older, 2.0)
        rows = after.campaign.touches(10, np.array([[1150.0, 0.0, 400.0]]), 0.03)
        task = after.task(rows, "tool", points=("S",), rough=np.full((1, 3), np.nan))
        nees.append(nees_of_tool(identify(task).identified, after.campaign.truth))
    assert as_foretold(nees, 3)
