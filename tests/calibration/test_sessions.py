"""A robot measured on several days, instrument or target set up anew between them: one robot all the same."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import PositionRows, Session, Split, Task, fit, identify
from tests.helpers.own_campaigns import Campaign, nominal_of, place, shape_error
from tests.helpers.own_model import small_motion

SIGMA = 0.05
ROWS, DAYS = 32, 3
FIT = ("Monday", "Tuesday", "Wednesday")
OWN = {"base": frozenset({"base"}), "tool": frozenset({"tool"}), "base,tool": frozenset({"base", "tool"})}
MEAN_OF_NOISE = SIGMA * np.sqrt(8.0 / np.pi)
"""Mean length of a noise of three coordinates."""


class Days:
    """The same robot at the same angles with the same noise, however instrument and target were set up each day."""

    def __init__(self, seed):
        self.campaign = Campaign.of(seed)
        rng = self.campaign.rng
        self.q = [self.campaign.asked(ROWS) for _ in range(DAYS)]
        self.noise = [rng.normal(0.0, SIGMA, (ROWS, 3)) for _ in range(DAYS)]
        self.bases = [self.campaign.truth.base, *(place(rng) for _ in range(DAYS - 1))]
        tool = self.campaign.truth.tool
        moved = [np.append(rng.uniform(-60, 60, 3), [0.3, -0.2, 0.5]) for _ in range(DAYS - 1)]
        self.tools = [tool, *(tool @ small_motion(six) for six in moved)]
        self.asked = self.campaign.asked()

    def truth(self, day, own):
        base, tool = (poses[day if part in own else 0] for part, poses in (("base", self.bases), ("tool", self.tools)))
        return replace(self.campaign.truth, base=base, tool=tool)

    def block(self, day, own, session, truth=None):
        """A day's positions, the noise turned with the instrument, so that it is the same seen from the robot."""
        arm = truth or self.truth(day, own)
        turned = self.noise[day] @ arm.base[:3, :3].T
        return PositionRows(self.q[day], arm.points(self.q[day]) + turned, np.full((ROWS, 3), SIGMA), session)

    def task(self, own, sessions=True, changed=None):
        """changed: the robot as it is on the last day."""
        blocks = [self.block(day, own, day if sessions else 0) for day in range(DAYS)]
        if changed:
            blocks[-1] = self.block(DAYS - 1, own, DAYS - 1, changed)
        named = tuple(Session(name, own) for name in FIT) if sessions else (Session(FIT[0]),)
        return Task(nominal_of(self.campaign.nominal), blocks, sessions=named)


def links_of(found):
    """What geometry the robot has, its covariance alike: zeros and links, by parameter."""
    mine = [index for index, group in enumerate(found.unknowns.groups) if group in ("zeros", "links")]
    return found.state.model.deviations[mine], found.covariance[np.ix_(mine, mine)]


@pytest.mark.parametrize("own", OWN.values(), ids=OWN)
def test_set_up_anew_every_day_the_robot_is_the_one_found_in_a_single_session(own):
    """An estimate from less knowledge differs from one with more by no more than it is less sure."""
    for seed in range(3):
        days = Days(seed)
        days.tools = days.tools[:1] * DAYS  # what another tool sees is another measurement
        together = identify(days.task(frozenset(), sessions=False)).identified
        apart = identify(days.task(own)).identified
        assert apart.converged
        (one, sure), (other, less_sure) = links_of(together), links_of(apart)
        wider = np.diag(less_sure) - np.diag(sure)
        assert np.all(wider > -1e-3 * np.diag(sure))
        assert np.all(np.diag(less_sure) < 1.5 * np.diag(sure))  # 32 rows can spare nine numbers
        assert np.all(np.abs(one - other) < 4.0 * np.sqrt(np.maximum(wider, 0.0) + 1e-3 * np.diag(sure)))


@pytest.mark.parametrize("own", OWN.values(), ids=OWN)
def test_the_error_over_sessions_is_the_one_said(own):
    true, said = [], []
    for seed in range(6):
        days = Days(seed)
        error, sigma = shape_error(identify(days.task(own)).identified, days.truth(0, own), days.asked)
        true.append(error)
        said.append(sigma)
    assert 0.7 < np.sqrt(np.mean(np.square(true)) / np.mean(np.square(said))) < 1.3  # 6 robots, 8 directions: 3 σ


@pytest.mark.parametrize("own", OWN.values(), ids=OWN)
def test_each_session_has_the_base_and_the_tool_that_it_was_set_up_with(own):
    days = Days(1)
    found = identify(days.task(own)).identified
    for day, model in enumerate(found.state.models):
        tips, true = model.tcp(days.asked), days.truth(day, own).points(days.asked)
        assert np.sqrt(np.mean(np.sum((tips - true) ** 2, axis=1))) < 0.1


@pytest.mark.parametrize("own", OWN.values(), ids=OWN)
def test_a_session_that_no_fit_saw_is_judged_by_all_but_where_it_stood(own):
    days = Days(2)
    by_day = Split.leaving_out([name for name in FIT for _ in range(ROWS)])
    result = fit(days.task(own), by_day)
    noise = MEAN_OF_NOISE * np.array([0.8, 1.25])
    assert noise[0] < result.test.mean < noise[1] < 3.0 * noise[1] < result.nominal.mean
    assert result.coverage_95 > 0.88  # of 96 rows: 3 σ below 0.95
    assert result.verdict == "better"


def test_where_an_unseen_session_stood_has_no_say_in_how_it_is_judged():
    days = Days(2)
    split = Split(np.arange(ROWS * 2), ((np.arange(ROWS * 2), np.arange(ROWS * 2, ROWS * 3)),))
    here = fit(days.task(OWN["base"]), split)
    days.bases[-1] = place(np.random.default_rng(5))
    there = fit(days.task(OWN["base"]), split)
    np.testing.assert_allclose(there.test_errors, here.test_errors, rtol=0, atol=1e-3 * SIGMA)
    np.testing.assert_allclose(there.nominal_errors, here.nominal_errors, rtol=0, atol=1e-3 * SIGMA)


@pytest.mark.parametrize("own", OWN.values(), ids=OWN)
def test_of_a_session_that_has_no_row_in_the_fit_just_that_is_said(own):
    split = Split(np.arange(ROWS * 2), ((np.arange(ROWS * 2), np.arange(ROWS * 2, ROWS * 3)),))
    told = fit(Days(2).task(own), split).observability
    assert not any("Wednesday" in words for words in told.unseen)
    last = told.hidden[-1]
    assert (last.reason, last.combinations) == ("no row of the fit belongs to session Wednesday", ())


def test_so_it_is_of_the_first_session():
    split = Split(np.arange(ROWS, ROWS * 3), ((np.arange(ROWS, ROWS * 3), np.arange(ROWS)),))
    told = fit(Days(2).task(OWN["base"]), split).observability
    assert [hidden.reason for hidden in told.hidden if not hidden.combinations] == [
        "no row of the fit belongs to the first session"
    ]


def test_another_robot_in_the_unseen_session_is_not_settled_away():
    days = Days(2)
    longer = days.truth(DAYS - 1, OWN["base,tool"]).moved(("a2", "d4"), (2.0, -2.0))
    split = Split(np.arange(ROWS * 2), ((np.arange(ROWS * 2), np.arange(ROWS * 2, ROWS * 3)),))
    sound = fit(days.task(OWN["base,tool"]), split)
    other = fit(days.task(OWN["base,tool"], changed=longer), split)
    assert other.test.mean > 5.0 * sound.test.mean
    assert other.coverage_95 < 0.5
    assert other.sigma_ok is False


@pytest.mark.parametrize(("own", "rows"), [("base", 4), ("base,tool", 6)])
def test_an_unseen_session_needs_twice_the_numbers_that_tie_it_to_the_robot(own, rows):
    days, fitted = Days(2), np.arange(ROWS * 2)
    for held_out, doubt in ((rows, False), (rows - 1, True)):
        result = fit(days.task(OWN[own]), Split(fitted, ((fitted, np.arange(ROWS * 2, ROWS * 2 + held_out)),)))
        words = f"session Wednesday has {3 * held_out} numbers to judge by, {3 * rows} at least"
        assert ("numbers to judge by" in result.verdict_reason) is doubt
        assert (words in result.verdict_reason) is doubt
