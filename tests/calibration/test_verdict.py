"""A verdict is a test on held-out rows, not a comparison of two means."""

from dataclasses import replace

import numpy as np
import pytest

from cellctl.calibration import (
    ErrorFigures,
    HeldOut,
    Split,
    judge,
    paired_verdict,
    rows_for_better,
    verdict_sentence,
)


def test_a_gain_beyond_its_own_scatter_is_better_and_a_loss_is_worse():
    rng = np.random.default_rng(0)
    shared = rng.uniform(0.2, 2.0, 30)
    gained = shared - 0.1 + rng.normal(0, 0.02, 30)
    assert paired_verdict(shared, gained) == "better"
    assert paired_verdict(gained, shared) == "worse"


def test_a_few_lucky_rows_are_no_better():
    nominal = np.full(30, 0.5)
    lucky = nominal.copy()
    lucky[0] = 0.0
    assert lucky.mean() < nominal.mean()
    assert paired_verdict(nominal, lucky) == "no better"


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_two_rows_prove_nothing(rows):
    assert paired_verdict(np.ones(rows), np.zeros(rows)) == "no better"


def test_no_difference_at_all_is_no_better():
    assert paired_verdict(np.ones(10), np.ones(10)) == "no better"


def alternating(rows: int, mean: float, deviation: float) -> np.ndarray:
    """Values (rows,), an even number, with this mean and standard deviation."""
    signs = np.tile([-1.0, 1.0], rows // 2)
    return mean + deviation * signs / signs.std(ddof=1)


def test_the_stated_number_of_rows_is_the_least_that_proves_such_a_gain():
    few = alternating(6, 1.0, 1.5)
    assert paired_verdict(few, np.zeros(6)) == "no better"
    assert rows_for_better(few, np.zeros(6)) == 12  # t(0.975, 11)·1.5/√12 = 0.95, with eleven 1.01
    assert paired_verdict(alternating(12, 1.0, 1.5), np.zeros(12)) == "better"
    assert paired_verdict(alternating(10, 1.0, 1.5), np.zeros(10)) == "no better"


@pytest.mark.parametrize(("mean", "deviation"), [(-0.5, 1.0), (0.01, 1.0)])
def test_a_loss_or_a_tiny_gain_has_no_number_of_rows_that_proves_it(mean, deviation):
    assert rows_for_better(alternating(6, mean, deviation), np.zeros(6)) is None


@pytest.mark.parametrize(("verdict", "word"), [("better", "Better"), ("worse", "Worse"), ("no better", "No better")])
def test_the_sentence_says_before_after_and_on_how_many_rows(verdict, word):
    said = verdict_sentence(verdict, ErrorFigures(0.9, 1.0, 2.0), ErrorFigures(0.02, 0.03, 0.06), 30, "touches")
    assert f"{word} than nominal" in said
    for figure in ("0.900", "0.020", "2.000", "0.060", "held-out touches", "mean of 30"):
        assert figure in said


def test_a_holdout_takes_its_share_and_the_seed_decides_which():
    first, again, other = (Split.holdout(100, 0.3, seed) for seed in (1, 1, 2))
    assert len(first.judged[0][1]) == 30
    assert not set(first.fit) & set(first.judged[0][1])
    assert first.fit.tolist() == again.fit.tolist() != other.fit.tolist()


def held_out(nominal, identified, foreseen, p_value=0.5):
    count = len(nominal)
    return HeldOut(nominal, identified, np.full(count, foreseen**2), np.broadcast_to(p_value, count))


RNG = np.random.default_rng(3)
BEFORE, AFTER = RNG.uniform(0.5, 1.5, 30), RNG.uniform(0.2, 0.8, 30)


def test_errors_of_the_size_foreseen_are_better_and_say_why():
    judged = judge(held_out(BEFORE, AFTER, 0.5))
    assert (judged.verdict, "beyond its own scatter" in judged.reason) == ("better", True)


def test_whether_sigma_can_be_trusted_is_not_in_the_verdict():
    p_value = np.where(np.arange(30) < 20, 0.5, 1e-4)
    judged = judge(held_out(BEFORE, AFTER, 0.05, p_value))
    assert (judged.verdict, judged.sigma_ok) == ("better", False)
    assert judged.sigma_reason.startswith("20 of 30 held-out rows lie in their 95 % region; 0.050 mm RMS predicted")
    trusted = judge(held_out(BEFORE, AFTER, 0.5))
    assert (trusted.verdict, trusted.sigma_ok) == ("better", True)


def test_rows_that_contradict_each_other_make_sigma_unreliable_and_no_gain_smaller():
    judged = judge(held_out(BEFORE, AFTER, 0.5), sigma_doubts=["the rows do not fit together"])
    assert (judged.verdict, judged.sigma_ok, judged.sigma_reason) == ("better", False, "the rows do not fit together")


def test_without_held_out_rows_nothing_is_said_of_sigma():
    assert judge(held_out(BEFORE[:0], AFTER[:0], 0.5), ["no row was held out"]).sigma_ok is None


def test_one_row_gone_wild_takes_the_verdict_with_it():
    worse = AFTER.copy()
    worse[4] = 100.15
    before = BEFORE.copy()
    before[4] = 100.0
    judged = judge(held_out(before, worse, 0.5))
    assert judged.verdict == "no better"
    assert "root mean square" in judged.reason


@pytest.mark.parametrize(("share", "word"), [(0.005, "no better"), (0.02, "better")])
def test_a_sure_gain_of_less_than_a_hundredth_is_too_small_to_matter(share, word):
    """The same share of every row's error: the paired test is sure of both."""
    found = judge(held_out(BEFORE, (1.0 - share) * BEFORE, 0.5))
    assert found.verdict == word
    assert ("too small to matter" in found.reason) == (word == "no better")


def test_doubts_keep_a_gain_from_being_proved_but_excuse_no_loss():
    assert judge(held_out(BEFORE, AFTER, 0.5), ["too few"]).reason == "too few"
    assert judge(held_out(BEFORE, AFTER, 0.5), ["too few"]).verdict == "no better"
    assert judge(held_out(AFTER, BEFORE, 0.5), ["too few"]).verdict == "worse"


def beside(prior, identified, nominal=BEFORE):
    return replace(held_out(nominal, identified, 0.5), prior=prior)


def test_registration_alone_need_not_be_better_than_the_prior_model_that_it_registers():
    rows = beside(AFTER, AFTER)
    alone, update = judge(rows, beat_prior=False), judge(rows)
    assert (alone.verdict, alone.against) == ("better", "nominal")
    assert (update.verdict, update.against) == ("no better", "prior")


def test_a_gain_on_both_is_better_than_both():
    judged = judge(beside(1.5 * AFTER, AFTER))
    assert (judged.verdict, judged.against) == ("better", "both")


@pytest.mark.parametrize("beat_prior", [True, False])
def test_a_loss_against_the_prior_model_is_worse_even_where_nominal_is_beaten(beat_prior):
    judged = judge(beside(0.7 * AFTER, AFTER), beat_prior=beat_prior)
    assert (judged.verdict, judged.against) == ("worse", "prior")


def test_a_sure_but_slight_loss_against_the_prior_model_is_what_freeing_parameters_costs():
    rows = beside(0.97 * AFTER, AFTER)
    assert paired_verdict(rows.prior, rows.identified) == "worse"
    assert (judge(rows).verdict, judge(rows).against) == ("no better", "prior")
    assert judge(rows, beat_prior=False).verdict == "better"


def test_no_better_than_nominal_is_no_better_whatever_the_prior_model_was():
    judged = judge(beside(1.5 * AFTER, AFTER, nominal=AFTER), beat_prior=False)
    assert (judged.verdict, judged.against) == ("no better", "nominal")


def test_the_sentence_names_the_baseline_that_decided_and_all_three_figures():
    three = (ErrorFigures(mean, mean, 2.0 * mean) for mean in (0.9, 0.3, 0.4))
    nominal, prior, test = three
    said = verdict_sentence("worse", nominal, test, 30, "touches", prior=prior, against="prior")
    means = "0.900 mm nominal robot, 0.300 mm prior model, 0.400 mm identified robot"
    measured = f"Error of held-out touches: {means} (mean of 30; max 1.800, 0.600, 0.800 mm)."
    assert said == f"{measured} Worse than the prior model: do not use this model."


def test_repeats_of_a_posture_count_as_one_row():
    """Nominal and identified are equally good; each posture comes five times, with a common error."""
    better = fooled = 0
    for seed in range(400):
        rng = np.random.default_rng(seed)
        errors = np.abs(np.repeat(rng.normal(3.0, 1.0, (2, 20)), 5, axis=1) + rng.normal(0.0, 0.3, (2, 100)))
        better += paired_verdict(*errors, posture=np.repeat(np.arange(20), 5)) == "better"
        fooled += paired_verdict(*errors) == "better"
    assert better <= 0.05 * 400 < 0.12 * 400 < fooled


def test_without_repeats_postures_change_nothing():
    rng = np.random.default_rng(1)
    before, after = rng.uniform(0.5, 1.0, 30), rng.uniform(0.4, 0.95, 30)
    assert paired_verdict(before, after, posture=rng.permutation(30)) == paired_verdict(before, after)


def test_a_sigma_that_is_right_is_known_to_be_from_enough_rows_only():
    normal = np.abs(np.random.default_rng(67).normal(0.0, 0.1, (200, 40)))
    answers = [[judge(held_out(np.full(n, 1.0), row[:n], 0.1)).sigma_ok for row in normal] for n in (5, 40)]
    assert answers[0].count(None) > 100
    assert answers[1].count(True) > 170


@pytest.mark.parametrize("rows", [5, 10, 30])
def test_a_sigma_too_small_by_half_passes_in_five_of_a_hundred_cases_at_most(rows):
    errors = np.abs(np.random.default_rng(rows).normal(0.0, 0.15, (400, rows)))
    passed = [judge(held_out(np.full(rows, 1.0), each, 0.1)).sigma_ok is True for each in errors]
    assert np.mean(passed) < 0.05 + 2.0 * np.sqrt(0.05 * 0.95 / 400)


def test_rows_that_cannot_show_the_whole_error_leave_sigma_open_but_not_a_failure():
    reason = "these rows do not show the whole error"
    errors = np.abs(np.random.default_rng(68).normal(0.0, 0.1, 40))
    agreeing = held_out(np.full(40, 1.0), errors, 0.1)
    assert judge(agreeing, sigma_open=reason).sigma_ok is None
    far = replace(agreeing, identified=3.0 * errors, p_value=np.full(40, 1e-3))
    assert judge(far, sigma_open=reason).sigma_ok is False
