"""Returns to the reference touch: what counts as a jump, and what the operator hears."""

from __future__ import annotations

import pytest

from procedures.steps.sphere.reference_touches import jump, remark
from procedures.steps.sphere.rows import ReferenceRow
from tests.helpers.steps import reference

SIGMA = 0.0245


def visit(shift_mm: float, sigma_mm: float = SIGMA) -> ReferenceRow:
    return reference(shift_mm, sigma_mm)


def test_scatter_is_no_jump() -> None:
    assert jump([visit(0.04), visit(-0.05)]) is None


def test_a_change_since_the_last_visit_beyond_five_sigma_is_a_jump() -> None:
    assert jump([visit(0.0), visit(5.1 * SIGMA)]) is not None
    assert jump([visit(0.0), visit(4.9 * SIGMA)]) is None


def test_with_a_very_repeatable_robot_a_tenth_of_a_millimetre_is_allowed() -> None:
    assert jump([visit(0.0, 0.001), visit(0.09, 0.001)]) is None
    assert jump([visit(0.0, 0.001), visit(0.11, 0.001)]) is not None


def test_the_first_return_is_compared_with_the_first_visit_itself() -> None:
    assert jump([visit(-0.5)]) is not None
    assert jump([visit(0.02)]) is None


def test_slow_drift_is_no_jump_however_far_it_goes() -> None:
    visits = [visit(-0.08 * number) for number in range(1, 10)]
    assert all(jump(visits[:count]) is None for count in range(1, 10))


@pytest.mark.parametrize(("shift", "words"), [(-0.6, "deeper into"), (0.6, "farther from")])
def test_a_jump_names_tip_and_robot_which_way_it_went_and_a_cure(shift: float, words: str) -> None:
    fault = jump([visit(shift)])
    assert fault is not None
    assert "tip" in fault.device
    assert "robot" in fault.device
    assert words in fault.what
    assert "0.600 mm" in fault.what
    assert "mastering" in fault.cure


def test_a_return_more_than_three_sigma_from_the_one_before_is_remarked_upon() -> None:
    assert remark([visit(0.0), visit(2.9 * SIGMA)]) is None
    assert "3.5 σ from the visit before" in (remark([visit(0.0), visit(-3.5 * SIGMA)]) or "")


def test_a_slow_drift_is_remarked_upon_once_it_is_more_than_three_sigma_from_the_first_visit() -> None:
    assert remark([visit(1.5 * SIGMA), visit(2.9 * SIGMA)]) is None
    assert "3.2 σ from the first visit" in (remark([visit(1.6 * SIGMA), visit(3.2 * SIGMA)]) or "")
