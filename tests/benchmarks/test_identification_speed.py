"""A whole identification beside pybotics: the same positions, the same 33 unknowns, to the same residual."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.benchmarks.side_by_side import median, race, side
from tests.benchmarks.textbook import save_rows
from tests.helpers.real_data import UR10_DATA, save_real_rows

HERE = Path(__file__).parent
OURS = [sys.executable, str(HERE / "cellctl_fits.py")]
NEAR = 1.03
"""pybotics may end at a residual this many times ours: it has no priors, and its last hundredths take it longest."""


@pytest.fixture
def compare(with_pybotics, tell, tmp_path):
    """Both on the same rows; a line in the table; what both said."""

    def run(count, scatter, promised, rounds=3):
        save = save_real_rows if scatter is None else lambda path, of: save_rows(path, of, scatter=scatter)
        rows = save(tmp_path / "rows.npz", count)
        with side(OURS, rows) as ours, side([*with_pybotics, str(HERE / "pybotics_fits.py")], rows) as theirs:
            found = race(ours, theirs, rounds, near=NEAR)
        kind = "measured on a real UR10" if scatter is None else f"scatter {scatter:.0f} σ"
        what = f"identify from {count} positions, {kind}"
        tell(what, words(found.ours), f"pybotics {words(found.theirs)}", f"{found.ratio:.0f} ×", f"≥ {promised} ×")
        return found

    return run


def words(answers):
    return f"{1e3 * median(answers, 'seconds'):.0f} ms, {median(answers, 'held_out'):.3f} mm held out"


def reach_the_same(found):
    """Residuals within `NEAR` of each other, ours no worse at fresh postures: else the speeds compare nothing."""
    residual, held_out = (
        median(found.theirs, figure) / median(found.ours, figure) for figure in ("residual", "held_out")
    )
    return 1.0 / NEAR <= residual <= NEAR + 1e-6 and held_out >= 1.0 / NEAR


@pytest.mark.long
def test_fifty_positions_are_identified_ten_times_as_fast_as_by_pybotics(compare):
    found = compare(50, 1.0, 10)
    assert reach_the_same(found)
    assert found.ratio >= 10


@pytest.mark.long
def test_fifty_positions_that_scatter_more_than_they_say_are_too(compare):
    found = compare(50, 3.0, 10)
    assert reach_the_same(found)
    assert found.ratio >= 10


@pytest.mark.long
@pytest.mark.parametrize("scatter", [1.0, 3.0])
def test_five_hundred_positions_are_identified_twenty_times_as_fast_as_by_pybotics(compare, scatter):
    found = compare(500, scatter, 20)
    assert reach_the_same(found)
    assert found.ratio >= 20


@pytest.mark.long
@pytest.mark.skipif(not UR10_DATA.exists(), reason=f"the UR10 measurements are not at {UR10_DATA}")
@pytest.mark.parametrize("count", [40, 50])
def test_few_positions_of_a_real_robot_are_identified_ten_times_as_fast_as_by_pybotics(compare, count):
    found = compare(count, None, 10)
    assert reach_the_same(found)
    assert found.ratio >= 10
