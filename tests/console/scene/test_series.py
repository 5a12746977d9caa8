"""The series of the charts: order of measurement, held-out points marked, and what is not known yet."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.console.scene.charts import (
    IDENTIFIED,
    NOMINAL,
    batch_options,
    changes,
    residual_options,
    series_of,
    sigma_options,
)
from tests.helpers.journals import SEARCH, MadeJournal, residuals_row, touch_run


def identified(run: MadeJournal) -> MadeJournal:
    """The run with residuals of its touches."""
    readings = [event.data["joints"] for event in run.events if getattr(event, "row_kind", "") == "touch"]
    run.row(
        "residuals", residuals_row(readings, [1.0] * len(readings), np.linspace(0.01, 0.02, len(readings)).tolist())
    )
    return run


def stand_off(number: int, when: str, error: float, sigma: float) -> dict[str, object]:
    joints = [0.0, -80.0, 80.0, 0.0, 40.0, 0.0]
    names = ("resting", "nominal", "commanded", "at_target", "at_contact")
    numbers = {"travel_mm": 10.0 + error, "error_mm": error, "expected_mm": 0.0, "sigma_mm": sigma}
    return {
        "number": number,
        "sphere": "P1",
        "run": when,
        "row": None,
        **dict.fromkeys(names, joints),
        "normal": [0.0, 0.0, 1.0],
        **numbers,
        **SEARCH,
    }


def test_points_are_in_the_order_of_measurement_and_held_out_ones_are_a_series_of_their_own() -> None:
    series = series_of(identified(touch_run(8, 8)).state())
    lines = {(line.robot, line.held_out): line for line in series.residuals}
    assert [place for place, _ in lines[IDENTIFIED, True].xy] == [4, 8]
    assert [place for place, _ in lines[IDENTIFIED, False].xy] == [1, 2, 3, 5, 6, 7]
    assert lines[NOMINAL, True].labels == ("touch 3", "touch 7")
    assert lines[IDENTIFIED, True].xy[0][1] == pytest.approx(0.01 + 3 * 0.01 / 7)


def test_targets_before_and_after_are_of_the_nominal_and_of_the_identified_robot() -> None:
    run = MadeJournal()
    run.row("standoff", stand_off(0, "before", -1.5, 0.0))
    run.row("standoff", stand_off(0, "after", -0.04, 0.03))
    series = series_of(run.state())
    assert {line.robot: line.xy for line in series.residuals} == {NOMINAL: ((1, 1.5),), IDENTIFIED: ((2, 0.04),)}
    assert series.sigmas[0].xy == ((2, 0.03),)
    assert series.errors[0].xy == ((2, 0.04),)


def test_what_is_not_known_yet_is_stated() -> None:
    empty, some = series_of(MadeJournal().state()), series_of(touch_run(30, 30).state())
    assert empty.residual_note == "No residual is known yet: it needs some measured points."
    assert some.residual_note.startswith("Preliminary: the nominal robot")
    assert some.sigma_note == "σ is not known yet: the identification predicts it."


def test_the_note_of_an_empty_chart_is_on_the_chart() -> None:
    options = sigma_options(series_of(touch_run(30, 30).state()))
    assert options["graphic"][0]["style"]["text"] == "σ is not known yet: the identification predicts it."


def batch(rows: int, high_mm: float, ended: str = "") -> dict[str, object]:
    quantiles = {"low_mm": high_mm / 3.0, "median_mm": high_mm / 2.0, "high_mm": high_mm, "next_mm": 0.9 * high_mm}
    numbers = {"rows": rows, "most": 150, "goal_mm": 0.1, "to_goal": 20, "seconds": 300.0}
    return {"noun": "touches", "model": "geometry", "doubt": "", "ended": ended, **quantiles, **numbers}


def test_a_campaign_with_a_goal_has_a_curve_of_the_predicted_error() -> None:
    run = touch_run(8, 8)
    assert series_of(run.state()).batches == ()
    run.row("batch", batch(35, 0.2))
    run.row("batch", batch(45, 0.09, "goal"))
    series = series_of(run.state())
    shown = {each["name"]: each["data"] for each in batch_options(series)["series"]}
    assert shown["95 %"] == [[35, 0.2], [45, 0.09]]
    assert shown["median"] == [[35, 0.1], [45, 0.045]]
    assert shown["goal: 0.1 mm"] == [[0, 0.1], [45, 0.1]]
    assert series.batch_note.endswith("the goal is met")


def test_a_new_point_changes_only_itself_on_the_chart() -> None:
    run = identified(touch_run(40, 40))
    run.row("standoff", stand_off(0, "before", 1.5, 0.0))
    run.row("standoff", stand_off(0, "after", 0.1, 0.03))
    once = residual_options(series_of(run.state()))
    run.row("standoff", stand_off(1, "after", 0.2, 0.03))
    found = changes(once, residual_options(series_of(run.state())))
    assert found is not None
    assert [len(each) for each in found] == [0] * 5 + [1]
    place, point = found[-1][0]
    assert (place, point[1]) == (1, 0.2)


def test_a_first_point_of_another_kind_draws_the_chart_anew() -> None:
    before, after = series_of(touch_run(30, 30).state()), series_of(identified(touch_run(30, 30)).state())
    assert changes(residual_options(before), residual_options(after)) is None
