"""What the page of the papers says follows from the numbers of the seeds."""

import pytest

from tests.studies.papers.statements import Figure, Interval, Ordering, Paper, Results, Section, holm, page_of


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


def holds(numbers):
    return numbers.outcome(ORDERING).holds(0.05)


def test_an_ordering_is_decided_where_the_interval_of_its_difference_excludes_zero():
    assert holds(results(a=[1.0, 1.1, 0.9], b=[2.0, 2.1, 1.8])) == "yes"
    assert holds(results(b=[1.0, 1.1, 0.9], a=[2.0, 2.1, 1.8])) == "no"
    assert holds(results(a=[1.0, 2.0, 1.5], b=[2.0, 1.0, 1.6])) == "not decided"


def test_numbers_that_are_equal_for_every_robot_decide_nothing():
    assert holds(results(a=[1.0, 2.0, 3.0], b=[1.0, 2.0, 3.0])) == "not decided"


def test_holms_level_decides_the_smallest_probabilities_until_one_is_too_large():
    level = holm([0.04, 0.001, 0.02, 0.012])
    assert [p < level for p in (0.001, 0.012, 0.02, 0.04)] == [True, True, True, True]
    level = holm([0.04, 0.001, 0.026, 0.012])
    assert [p < level for p in (0.001, 0.012, 0.026, 0.04)] == [True, True, False, False]
    assert holm([0.013] * 4) <= 0.013


def test_among_many_comparisons_a_weak_one_is_not_decided():
    weak = results(a=[1.0, 1.1, 0.9], b=[1.5, 1.43, 1.57], gear__a=[1.0, 2.0, 1.5], gear__b=[2.0, 1.0, 1.6])
    assert holds(weak) == "yes"
    assert "| not decided (3 of 3) |" in page_of(paper(), weak)


def test_differences_are_those_of_the_same_seed():
    assert holds(results(a=[1.0, 10.0, 100.0], b=[1.1, 10.11, 100.09])) == "yes"


def paper():
    return Paper("xyz", "A paper", "a command", None, (Section("Part", (Figure("length", "0.5", "a"), ORDERING)),))


def test_the_page_names_the_switch_that_restores_an_ordering():
    text = page_of(
        paper(), results(a=[2.0, 2.1, 1.8], b=[1.0, 1.1, 0.9], gear__a=[1.0, 1.1, 0.9], gear__b=[2.0, 2.1, 1.8])
    )
    assert "no (0 of 3)" in text
    assert "yes: `gear` (0.967 ±" in text


def test_the_page_names_the_switch_that_reverses_an_ordering():
    text = page_of(
        paper(), results(gear__a=[2.0, 2.1, 1.8], gear__b=[1.0, 1.1, 0.9], a=[1.0, 1.1, 0.9], b=[2.0, 2.1, 1.8])
    )
    assert "yes (3 of 3)" in text
    assert "no: `gear` (-0.967 ±" in text


def test_the_page_says_where_no_switch_restores_an_ordering():
    numbers = results(a=[2.0, 2.1, 1.8], b=[1.0, 1.1, 0.9], gear__a=[2.0, 2.1, 1.8], gear__b=[1.0, 1.1, 0.9])
    assert "none of `gear`" in page_of(paper(), numbers)
