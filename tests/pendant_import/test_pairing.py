"""Postures and positions that belong together, and no others; what is in no pair is named by line, in both files."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.files import InputError
from cellctl.pendant_import import Choices
from cellctl.pendant_import._pairing import paired
from cellctl.pendant_import._points import TABLE, Point, PointList, Source

KRL = Source("krl", x_before_names=True)


def postures(*names, source=KRL, faults=()):
    return _list("joints.dat", source, names, "A1", faults)


def positions(*names, faults=()):
    return _list("positions.csv", TABLE, names, "X", faults)


def _list(file, source, names, column, faults):
    points = [Point(line, name, {column: line}, "faulty" * (line in faults)) for line, name in enumerate(names, 1)]
    return PointList(file, source, tuple(points))


def pairs(joints, measured, **choices):
    return [(a.line, b.line) for a, b in paired(joints, measured, Choices(**choices)).pairs]


def left_out(joints, measured, **choices):
    return {(row.file[0], row.line): row.reason for row in paired(joints, measured, Choices(**choices)).left_out}


NAMES = st.lists(st.integers(1, 60), min_size=1, max_size=30, unique=True)


@given(NAMES, NAMES, st.sampled_from(["P{}", "p {}", "P0{}", "P_{}", "XP{}", "{}"]))
def test_by_name_every_row_is_in_its_one_pair_or_named_whatever_the_order(first, second, style):
    joints, measured = postures(*(f"XP{n}" for n in first)), positions(*(style.format(n) for n in second))
    both = set(first) & set(second)
    if not both:
        with pytest.raises(InputError, match="no name is in both lists"):
            paired(joints, measured, Choices())
        return
    assert sorted(pairs(joints, measured)) == sorted((first.index(n) + 1, second.index(n) + 1) for n in both)
    missing = {("j", first.index(n) + 1) for n in set(first) - both} | {
        ("p", second.index(n) + 1) for n in set(second) - both
    }
    assert left_out(joints, measured).keys() == missing


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=30))
def test_by_order_a_row_that_cannot_be_used_shifts_none_of_those_after_it(bad):
    lines = range(1, len(bad) + 1)
    joints = postures(*[""] * len(bad), faults=[line for line in lines if bad[line - 1][0]])
    measured = positions(*[""] * len(bad), faults=[line for line in lines if bad[line - 1][1]])
    good = [line for line in lines if not any(bad[line - 1])]
    assert pairs(joints, measured) == [(line, line) for line in good]
    assert left_out(joints, measured).keys() == {(file, line) for line in lines if line not in good for file in "jp"}


def test_different_counts_are_never_paired_by_order():
    for choices in ({}, {"pair": "order"}):
        with pytest.raises(InputError, match="3 postures, but 2 positions"):
            pairs(postures("", "", ""), positions("", ""), **choices)


def test_numbers_with_a_gap_are_not_paired_by_order_unless_the_user_insists():
    joints, measured = postures("", "", ""), positions("1", "2", "4")
    with pytest.raises(InputError, match="number 4, where 3 is next"):
        pairs(joints, measured)
    assert pairs(joints, measured, pair="order") == [(1, 1), (2, 2), (3, 3)]
    assert pairs(joints, measured, pair="name") == [(1, 1), (2, 2)]


def test_numbers_that_do_not_begin_with_the_first_row_are_not_paired_by_order():
    with pytest.raises(InputError, match="number 2, where 1 is next"):
        pairs(postures("", ""), positions("2", "3"))
    assert pairs(postures("", ""), positions("0", "1")) == [(1, 1), (2, 2)]


def test_a_row_typed_twice_and_another_forgotten_is_found_though_the_counts_agree():
    joints = postures("", "", "")
    measured = PointList("p.csv", TABLE, tuple(Point(line, "", {"X": x}) for line, x in [(2, 1.0), (3, 1.0), (4, 3.0)]))
    with pytest.raises(InputError, match=r"p\.csv:3: the same numbers as line 2: typed twice"):
        pairs(joints, measured)


def test_order_against_the_names_is_obeyed_and_said():
    result = paired(postures("XP1", "XP2"), positions("P2", "P1"), Choices(pair="order"))
    assert [(a.line, b.line) for a, b in result.pairs] == [(1, 1), (2, 2)]
    assert any("2 pairs bear different names" in said for said in result.decided)


def test_numbers_alone_are_the_numbers_of_names_that_all_begin_alike():
    assert pairs(postures("XP1", "XHOME", "XP2"), positions("2", "1")) == [(3, 1), (1, 2)]
    with pytest.raises(InputError, match="no name is in both"):
        pairs(postures("XP1", "XQ1"), positions("1"))


def test_names_that_only_look_alike_are_different():
    assert pairs(postures("P1.1", "P11", source=TABLE), positions("P11", "P1.1")) == [(2, 1), (1, 2)]
    assert pairs(postures("XP10", "XP1"), positions("P1", "P10")) == [(2, 1), (1, 2)]
    assert pairs(postures("XP100", "XP10"), positions("P10", "P100")) == [(2, 1), (1, 2)]
    assert pairs(postures("xa", "a", source=TABLE), positions("a", "xa")) == [(2, 1), (1, 2)]


def test_one_name_with_two_positions_gives_none_of_them_unless_both_are_measurements():
    joints, measured = postures("XP1", "XP2"), positions("P1", "P2", "P1")
    assert pairs(joints, measured) == [(2, 2)]
    reasons = left_out(joints, measured)
    assert reasons.keys() == {("j", 1), ("p", 1), ("p", 3)}
    assert "line 3 too" in reasons["p", 1]
    assert "line 1 too" in reasons["p", 3]
    assert sorted(pairs(joints, measured, repeats=True)) == [(1, 1), (1, 3), (2, 2)]


def test_two_postures_of_one_name_are_never_both_right():
    assert pairs(postures("XP1", "XP2", "XP1"), positions("P1", "P2"), repeats=True) == [(2, 2)]


def test_a_copy_of_a_row_is_left_out_and_the_first_one_used():
    measured = PointList("p.csv", TABLE, tuple(Point(line, "P1", {"X": 1.0}) for line in (2, 5)))
    result = paired(postures("XP1"), measured, Choices())
    assert [(a.line, b.line) for a, b in result.pairs] == [(1, 2)]
    assert [(row.line, row.reason) for row in result.left_out] == [(5, "the same numbers as line 2")]


def test_a_good_row_is_used_beside_a_faulty_one_of_its_name():
    measured = positions("P1", "P1", faults=[1])
    assert pairs(postures("XP1"), measured) == [(1, 2)]
    assert left_out(postures("XP1"), measured) == {("p", 1): "faulty"}


def test_lists_without_names_cannot_be_paired_by_name():
    with pytest.raises(InputError, match="neither this list nor the other has names"):
        pairs(postures(""), positions(""), pair="name")


def test_a_forgotten_name_leaves_its_row_out_and_shifts_nothing():
    joints, measured = postures("XP1", "XP2", "XP3"), positions("P1", "", "P3")
    assert pairs(joints, measured) == [(1, 1), (3, 3)]
    assert left_out(joints, measured).keys() == {("j", 2), ("p", 2)}
