"""The device's clock mapped to the cell's: right where the fastest messages are fast, honest where they are not."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellctl.clock import MinimumDelayFit
from cellctl.clock._minimum_delay import MAX_DRIFT

MS = 1_000_000
OFFSET = 123_456_789_000


def collected(delays_ns, *, drift=0.0, offset=OFFSET, period_ns=50 * MS, start_ns=0, window_s=20.0):
    """Messages a period apart, each `delays_ns` late. The truth: cell = device · (1 + drift) + offset."""
    fit = MinimumDelayFit(window_s)
    for index, delay in enumerate(delays_ns):
        device = start_ns + index * period_ns
        fit.add(device, truth(device, drift, offset) + delay)
    return fit


def truth(device_ns, drift, offset=OFFSET):
    return device_ns + round(device_ns * drift) + offset


@given(st.integers(0, 2**32), st.floats(-2e-4, 2e-4), st.integers(-(10**15), 10**15), st.integers(0, 10**12))
def test_with_a_fast_message_now_and_then_the_map_is_exact_to_10_us(seed, drift, offset, start_ns):
    chance = random.Random(seed)
    delays = [0 if index % 4 == 0 else chance.randrange(16 * MS) for index in range(100)]
    fit = collected(delays, drift=drift, offset=offset, start_ns=start_ns).fit()
    for device in (start_ns, start_ns + 2_500 * MS, start_ns + 5_000 * MS):
        assert abs(fit.to_cell_ns(device) - truth(device, drift, offset)) < 10_000
    assert fit.drift == pytest.approx(drift, abs=1e-7)


@given(st.lists(st.integers(0, 16 * MS), min_size=2, max_size=150), st.floats(-2e-4, 2e-4))
def test_no_message_ever_arrives_before_the_map_says_it_was_sent(delays, drift):
    made = collected(delays, drift=drift)
    fit = made.fit()
    for index, delay in enumerate(delays):
        device = index * 50 * MS
        assert fit.to_cell_ns(device) <= truth(device, drift) + delay + 2


def test_the_map_is_the_line_under_all_points_that_lies_closest():
    """Against brute force: of all lines through two points and under the others, the one with the least sum."""
    chance = random.Random(3)
    for _ in range(50):
        points = [(n * 100 * MS, chance.randrange(1000)) for n in range(12)]
        fit = MinimumDelayFit()
        for x, delay in points:
            fit.add(x, x + delay)
        best = min(
            sum(y - (ya + slope * (x - xa)) for x, y in points)
            for i, (xa, ya) in enumerate(points)
            for xb, yb in points[i + 1 :]
            for slope in [(yb - ya) / (xb - xa)]
            if all(y - (ya + slope * (x - xa)) >= -1e-6 for x, y in points)
        )
        found = fit.fit()
        assert sum(x + y - found.to_cell_ns(x) for x, y in points) == pytest.approx(best, abs=len(points))


def test_a_delay_that_every_message_shares_is_in_the_offset():
    fit = collected([2 * MS] * 50).fit()
    assert fit.to_cell_ns(0) == OFFSET + 2 * MS
    assert fit.sigma_ns == 0


def test_sigma_tells_a_well_supported_envelope_from_one_that_hangs_on_two_messages():
    chance = random.Random(1)
    many_fast = collected([0 if n % 3 == 0 else chance.randrange(16 * MS) for n in range(90)]).fit()
    two_fast = collected([0 if n in (10, 80) else 4 * MS + chance.randrange(12 * MS) for n in range(90)]).fit()
    assert many_fast.sigma_ns < 1000
    assert two_fast.sigma_ns > 1 * MS


def test_few_messages_do_not_claim_an_exact_map():
    """The line goes through the fastest two whatever they are; the third says how good that is."""
    assert collected([0, 5 * MS, 3 * MS, 0, 4 * MS], period_ns=200 * MS).fit().sigma_ns >= 3 * MS


def test_below_half_a_second_the_drift_is_taken_as_none():
    assert collected([0, 5 * MS, 7 * MS], period_ns=100 * MS).fit().drift == 0.0


def test_a_drift_beyond_what_clocks_do_is_held_to_the_bound_with_all_messages_above():
    made = collected([0] * 40, drift=5e-3)
    fit = made.fit()
    assert fit.drift == MAX_DRIFT
    assert all(fit.to_cell_ns(n * 50 * MS) <= truth(n * 50 * MS, 5e-3) + 1 for n in range(40))


def test_the_map_follows_a_drift_that_changes():
    """A warming crystal: only the last window counts."""
    fit = MinimumDelayFit(window_s=5.0)
    cell = 0
    for n in range(400):
        cell += round(50 * MS * (1 + (100e-6 if n < 200 else -50e-6)))
        fit.add(n * 50 * MS, cell)
    assert fit.fit().drift == pytest.approx(-50e-6, abs=1e-7)
    assert len(fit) <= 101


def test_after_clear_nothing_of_the_old_map_is_left():
    fit = collected([0] * 20)
    fit.clear()
    assert len(fit) == 0
    fit.add(5, 1000)
    assert fit.fit().to_cell_ns(5) == 1000


def test_without_a_message_there_is_no_map():
    with pytest.raises(ValueError, match="no message"):
        MinimumDelayFit().fit()


def test_messages_out_of_order_give_the_same_map():
    delays = [random.Random(9).randrange(5 * MS) for _ in range(50)]
    pairs = [(n * 50 * MS, truth(n * 50 * MS, 5e-5) + d) for n, d in enumerate(delays)]
    in_order, mixed = MinimumDelayFit(), MinimumDelayFit()
    for pair in pairs:
        in_order.add(*pair)
    for pair in sorted(pairs, key=lambda p: p[0] % (150 * MS)):
        mixed.add(*pair)
    assert mixed.fit().to_cell_ns(10**9) == pytest.approx(in_order.fit().to_cell_ns(10**9), abs=2)


def test_two_messages_with_one_stamp_count_once_with_the_faster_arrival():
    fit = MinimumDelayFit()
    for arrival in (900, 400, 700):
        fit.add(100, arrival)
    assert (fit.fit().to_cell_ns(100), fit.fit().count) == (400, 1)
