"""The control chart of individual values: limits of a published example, each rule, and its false alarms."""

from __future__ import annotations

import numpy as np
import pytest

from cellctl.metrology import ControlChart, Signal, control_chart

FLOW_RATES = [49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]
"""Individual values of the example in NIST/SEMATECH e-Handbook 6.3.2.2."""


def signals_at(chart: ControlChart, rule: Signal) -> list[int]:
    return [point for point, rules in enumerate(chart.signals) if rule in rules]


def test_limits_are_those_of_the_handbooks_example() -> None:
    chart = control_chart(FLOW_RATES, len(FLOW_RATES))
    assert chart.centre == pytest.approx(50.81)
    assert chart.mean_range == pytest.approx(1.8778, abs=1e-4)
    assert chart.limits == pytest.approx((45.8159, 55.8041), abs=2e-3)
    assert chart.signalling == []


def test_the_limits_come_from_the_baseline_alone() -> None:
    later = control_chart([*FLOW_RATES, 80.0, 81.0], len(FLOW_RATES))
    assert later.limits == control_chart(FLOW_RATES, 10).limits
    assert later.signals[10] == (Signal.BEYOND, Signal.RANGE)
    assert later.signals[11] == (Signal.BEYOND,)


def test_eight_points_on_one_side_signal_and_seven_do_not() -> None:
    baseline = [1.0, -1.0] * 10
    assert signals_at(control_chart([*baseline, *[0.3] * 9], 20), Signal.ONE_SIDE) == [27, 28]
    assert signals_at(control_chart([*baseline, *[0.3] * 7], 20), Signal.ONE_SIDE) == []
    assert signals_at(control_chart([*baseline, 1.0, *[-0.3] * 8], 20), Signal.ONE_SIDE) == [28]


def test_six_points_each_above_the_one_before_signal_and_five_do_not() -> None:
    baseline = [1.0, -1.0] * 10
    rising = [-1.0, -0.8, -0.5, -0.2, 0.3, 0.5]
    assert signals_at(control_chart([*baseline, *rising[1:]], 20), Signal.RISING) == [24]
    assert signals_at(control_chart([*baseline, *rising[2:]], 20), Signal.RISING) == []
    falling = [1.0, *(-value for value in rising)]
    assert signals_at(control_chart([*baseline, *falling], 20), Signal.FALLING) == [26]
    assert str(Signal.FALLING) == "6 points falling"


def test_a_trend_in_the_baseline_does_not_widen_the_limits_as_its_standard_deviation_would() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=40) + np.linspace(0.0, 8.0, 40)
    assert control_chart(values, 40).sigma < 0.6 * values.std()


def test_without_a_change_the_rate_of_points_beyond_the_limits_is_the_stated_one() -> None:
    rng = np.random.default_rng(2)
    chart = control_chart(rng.normal(5.0, 0.1, 50_000), 50_000)
    assert len(signals_at(chart, Signal.BEYOND)) / 50_000 == pytest.approx(0.0027, abs=0.0008)


@pytest.mark.parametrize(("values", "baseline"), [([1.0], 20), ([1.0, 2.0], 1), ([1.0, np.nan, 2.0], 3)])
def test_too_few_or_missing_values_are_refused(values: list[float], baseline: int) -> None:
    with pytest.raises(ValueError, match=r"values for the baseline|missing"):
        control_chart(values, baseline)
