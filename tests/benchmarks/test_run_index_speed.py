"""Lists of runs by their index beside reading every journal: what an unchanged folder costs, and a page of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cellctl.installed import histories
from cellctl.operations.run_indexing import compared_series, current_index, read_run, series_of, summary_of
from cellctl.run_index import RunFilter
from tests.helpers.many_runs import made_runs

ROBOTS, DAYS = 20, 25
"""75 000 runs, as docs/results.md has them, take minutes to make; what a list costs for each run is the same."""


@pytest.mark.long
def test_lists_and_pages_by_the_index_cost_a_small_part_of_reading_the_journals(
    tell: Callable[..., None], tmp_path: Path
) -> None:
    made_runs(tmp_path, ROBOTS, DAYS)
    with current_index(tmp_path):
        pass
    (daily,) = (each for each in histories() if each.name == "daily")
    journals = _cpu_s(lambda: [read_run(journal.parent) for journal in tmp_path.glob("*/journal.sqlite")])

    def listed() -> None:
        with current_index(tmp_path) as index:
            assert len(index.lines(RunFilter(), "run", "began", "state")) == ROBOTS * DAYS

    with current_index(tmp_path) as index:
        page = _cpu_s(lambda: [summary_of(each) for each in index.page(RunFilter(text="r00007 kim"), limit=25)])
        history = _cpu_s(lambda: compared_series(index, daily, series_of(index, daily)[0].series))
    whole = _cpu_s(listed)
    many = ROBOTS * DAYS
    for name, found, most in (("list", whole, 5), ("search, 25 rows", page, 10), ("history of a robot", history, 2)):
        ratio = journals / found
        tell(
            f"{name}, {many} runs",
            f"{1e3 * found:.1f} ms",
            f"journals {journals:.2f} s",
            f"{ratio:.0f} ×",
            f"> {most} ×",
        )
        assert ratio > most


def _cpu_s(work: Callable[[], Any]) -> float:
    """CPU seconds of the fastest of three times."""
    found = []
    for _ in range(3):
        began = time.process_time()
        work()
        found.append(time.process_time() - began)
    return min(found)
