"""A verdict is a test on held-out rows, not a comparison of two means."""

import numpy as np
import pytest

from cellctl.calibration import ErrorFigures, Split, paired_verdict, verdict_sentence


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


@pytest.mark.parametrize(("verdict", "word"), [("better", "Better"), ("worse", "Worse"), ("no better", "No better")])
def test_the_sentence_says_before_after_and_on_how_many_rows(verdict, word):
    said = verdict_sentence(verdict, ErrorFigures(0.9, 1.0, 2.0), ErrorFigures(0.02, 0.03, 0.06), 30, "touches")
    assert said.startswith(word)
    for figure in ("0.900", "0.020", "2.000", "0.060", "30 held-out touches"):
        assert figure in said


def test_a_holdout_takes_its_share_and_the_seed_decides_which():
    first, again, other = (Split.holdout(100, 0.3, seed) for seed in (1, 1, 2))
    assert len(first.judged[0][1]) == 30
    assert not set(first.fit) & set(first.judged[0][1])
    assert first.fit.tolist() == again.fit.tolist() != other.fit.tolist()
