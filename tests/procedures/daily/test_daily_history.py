"""Histories of daily checks: which checks are compared, what their charts show, and which are left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cellctl.installed import histories
from cellctl.metrology import Signal
from cellctl.operations.run_indexing import ComparedSeries, current_index, history_page
from procedures.steps.daily.history import DailyHistory
from tests.helpers.journals import NOISE_MM, POINTS, check


def daily_histories(folder: Path, baseline_runs: int | None = None) -> ComparedSeries:
    (daily,) = (each for each in histories() if each.name == "daily")
    with current_index(folder) as index:
        return history_page(index, daily, baseline_runs)


@pytest.fixture(scope="module")
def grown(tmp_path_factory: pytest.TempPathFactory) -> DailyHistory:
    """Twenty checks of a robot, then eight after it grew by 0.5 mm/m."""
    folder = tmp_path_factory.mktemp("grown")
    for number in range(28):
        check(folder, number, grown=5e-4 * (number >= 20))
    (history,) = daily_histories(folder).histories
    return history


def test_checks_are_in_the_order_of_their_dates_with_their_verdicts(grown: DailyHistory) -> None:
    assert [each.run for each in grown.checks] == [f"check-{number:02d}" for number in range(28)]
    assert (grown.checks[0].verdict, grown.checks[0].t2, grown.provisional) == ("in control", 3.5, False)


def test_a_grown_robot_signals_on_the_chart_of_scale_and_on_no_other(grown: DailyHistory) -> None:
    scale = grown.charts["scale"]
    size = np.sqrt(np.mean(np.sum((POINTS - POINTS.mean(axis=0)) ** 2, axis=1)))
    assert scale.values[20:].mean() - scale.values[:20].mean() == pytest.approx(5e-4 * size, rel=0.05)
    assert all(Signal.BEYOND in rules for rules in scale.signals[20:])
    assert Signal.ONE_SIDE in scale.signals[27]
    for name in ("x", "y", "z", "turn x", "turn y", "turn z"):
        assert not any(Signal.BEYOND in rules for rules in grown.charts[name].signals[20:]), name


def test_where_the_instrument_stands_does_not_matter(grown: DailyHistory) -> None:
    """It stands up to a metre from its first place: the charts show the noise of points and nests alone."""
    assert grown.charts["x"].sigma < 3.0 * NOISE_MM


def test_limits_can_be_taken_from_fewer_checks(tmp_path: Path) -> None:
    for number in range(6):
        check(tmp_path, number)
    (history,) = daily_histories(tmp_path, baseline_runs=3).histories
    assert (history.charts["x"].baseline, history.provisional) == (3, True)


def test_checks_that_cannot_be_compared_have_histories_of_their_own_and_damaged_ones_are_named(tmp_path: Path) -> None:
    for number in range(3):
        check(tmp_path, number)
    check(tmp_path, 3, payload_kg=20.0)
    check(tmp_path, 4, state="aborted")
    check(tmp_path, 5, points=None)
    found = daily_histories(tmp_path)
    assert found.left_out == (("check-05", "its journal is damaged"),)
    assert [len(history.checks) for history in found.histories] == [1, 3]
    assert found.histories[0].charts == {}


def test_json_has_every_value_limit_and_signal(grown: DailyHistory) -> None:
    (scale,) = (chart for chart in grown.to_json()["charts"] if chart["name"] == "scale")
    assert scale["ranges"][0] is None
    assert len(scale["values"]) == len(scale["signals"]) == 28
    assert "beyond 3 σ" in scale["signals"][20]
    assert scale["lower"] < scale["centre"] < scale["upper"]
