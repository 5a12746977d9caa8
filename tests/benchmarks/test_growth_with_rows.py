"""Ten times as many rows cost about ten times as much, outliers among them or not: nothing grows with their square."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.benchmarks.side_by_side import median, race, side
from tests.benchmarks.textbook import save_rows

FITS = [sys.executable, str(Path(__file__).parent / "cellctl_fits.py")]
FEW, TIMES = 500, 10


@pytest.mark.long
@pytest.mark.parametrize("outlying", [0.0, 0.02])
def test_ten_times_as_many_rows_take_nowhere_near_a_hundred_times_as_long(tell, tmp_path, outlying):
    few = save_rows(tmp_path / "few.npz", FEW, outlying=outlying)
    many = save_rows(tmp_path / "many.npz", TIMES * FEW, outlying=outlying)
    with side(FITS, few) as one, side(FITS, many) as ten:
        found = race(one, ten, rounds=2)
    short, long = (f"{1e3 * median(answers, 'seconds'):.0f} ms" for answers in (found.ours, found.theirs))
    tell(
        f"identify from {TIMES * FEW} positions, {outlying:.0%} outliers",
        long,
        f"from {FEW}: {short}",
        f"{found.ratio:.0f} × as long",
        "–",
    )
    assert found.ratio <= 4 * TIMES
