"""What the page of the papers says follows from the numbers of the seeds."""

import pytest

from tests.studies.papers.statements import Figure, Interval, Ordering, Paper, Results, Section, page_of


def results(**by_key):
    seeds = range(1, 1 + len(next(iter(by_key.values()))))
    return Results(
        {seed: {key.replace("__", "/"): values[seed - 1] for key, values in by_key.items()} for seed in seeds}
    )


ORDERING = Ordering("a < b", "1 < 2", "a", "b", worlds=("gear",))


def test_the_confidence_interval_is_that_of_students_t():
    found = Interval.of([1.0, 2.0, 3.0, 4.0])
    assert found.mean == pytest.approx(2.5)
    assert found.half == pytest.approx(3.182 * 1.2910 / 2.0, rel=1e-3)


def test_an_ordering_holds_where_the_interval_of_its_difference_excludes_zero():
    assert results(a=[1.0, 1.1, 0.9], b=[2.0, 2.1, 1.8]).outcome(ORDERING).holds == "yes"
    assert results(b=[1.0, 1.1, 0.9], a=[2.0, 2.1, 1.8]).outcome(ORDERING).holds == "no"
    assert results(a=[1.0, 2.0, 1.5], b=[2.0, 1.0, 1.6]).outcome(ORDERING).holds == "not decided"


def test_differences_are_those_of_the_same_seed():
    assert results(a=[1.0, 10.0, 100.0], b=[1.1, 10.11, 100.09]).outcome(ORDERING).holds == "yes"


def paper():
    return Paper("xyz", "A paper", None, None, (Section("Part", (Figure("length", "0.5", "a"), ORDERING)),))


def test_the_page_names_the_switch_that_restores_an_ordering():
    text = page_of(
        paper(), results(a=[2.0, 2.1, 1.8], b=[1.0, 1.1, 0.9], gear__a=[1.0, 1.1, 0.9], gear__b=[2.0, 2.1, 1.8])
    )
    assert "no (0 of 3)" in text
    assert "`gear` (0.967 ±" in text


def test_the_page_says_where_no_switch_restores_an_ordering():
    numbers = results(a=[2.0, 2.1, 1.8], b=[1.0, 1.1, 0.9], gear__a=[2.0, 2.1, 1.8], gear__b=[1.0, 1.1, 0.9])
    assert "none of `gear`" in page_of(paper(), numbers)
