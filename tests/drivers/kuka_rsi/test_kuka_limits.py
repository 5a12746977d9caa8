"""The watch over each correction, the path, and one search cycle by cycle, without any process or socket."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.kuka_rsi.cyclic.limits import CycleWatch, Limit, SearchLimits
from drivers.kuka_rsi.cyclic.search_cycle import SearchCycle, SetPoint
from drivers.kuka_rsi.cyclic.session import Admission, AnswerDelay, Cause, CycleTiming, Phase, SearchOrder
from drivers.kuka_rsi.cyclic.telegram import Telegram

CYCLE_S = 0.004
LOW = SearchLimits()
_WIDE = {"correction_deg": 50, "speed_deg_s": 1e6, "acceleration_deg_s2": 1e9, "jerk_deg_s3": 1e12, "travel_deg": 50}
WIDE = SimpleNamespace(**_WIDE)  # above every ceiling, so that one limit can be looked at by itself
HOME = (0.0,) * 6


def axis2(value: float) -> tuple[float, ...]:
    return (0.0, value, 0.0, 0.0, 0.0, 0.0)


def only(**limit: float) -> SimpleNamespace:
    return SimpleNamespace(**{**_WIDE, **limit})


@pytest.mark.parametrize(
    ("limits", "within", "beyond", "limit"),
    [
        (only(correction_deg=1), axis2(1.0), axis2(1.001), Limit.CORRECTION),
        (only(travel_deg=1), (0.7, 0.7, 0, 0, 0, 0), (0.8, 0.8, 0, 0, 0, 0), Limit.TRAVEL),
        (only(speed_deg_s=1), axis2(0.004), axis2(0.00401), Limit.SPEED),
        (only(acceleration_deg_s2=10), axis2(16e-5), axis2(161e-6), Limit.ACCELERATION),
        (only(jerk_deg_s3=1000), axis2(64e-6), axis2(65e-6), Limit.JERK),
        (WIDE, axis2(1.0), axis2(math.nan), Limit.TRAVEL),
    ],
)
def test_a_correction_is_sent_up_to_each_limit_and_not_beyond(limits, within, beyond, limit):
    assert CycleWatch(limits, CYCLE_S).look(within) is Limit.NONE
    assert CycleWatch(limits, CYCLE_S).look(beyond) is limit


def test_what_was_refused_does_not_count_as_sent():
    watch = CycleWatch(only(speed_deg_s=1), CYCLE_S)
    assert watch.look(axis2(0.008)) is Limit.SPEED
    assert watch.look(axis2(0.0041)) is Limit.SPEED
    assert watch.look(axis2(0.004)) is Limit.NONE


@given(
    st.floats(0.001, 5),
    st.floats(0.01, 10),
    st.floats(1, 200),
    st.floats(10, 20_000),
    st.sampled_from([0.004, 0.012]),
    st.integers(0, 400),
)
def test_every_planned_path_passes_the_watch_also_when_it_is_stopped_anywhere(
    length, speed, acceleration, jerk, cycle_s, stop
):
    limits = only(speed_deg_s=speed, acceleration_deg_s2=acceleration, jerk_deg_s3=jerk)
    watch, point = CycleWatch(limits, cycle_s), SetPoint(axis2(length), speed, limits, cycle_s)
    for _ in range(stop):
        point.advance()
        assert watch.look(point.correction) is Limit.NONE
    before = point.correction[1]
    point.brake()
    assert watch.look(point.correction, braking=True) is Limit.NONE
    assert before - 1e-12 <= point.correction[1] <= length + 1e-12
    assert watch.look(point.correction, braking=True) is Limit.NONE


def test_a_line_of_no_length_has_arrived():
    point = SetPoint(HOME, 1.0, LOW, CYCLE_S)
    point.advance()
    assert point.arrived
    assert point.correction == HOME


TWO_DEG = axis2(2.0)


class Rig:
    """Feeds a search telegram by telegram; the joints follow at once."""

    def __init__(self, correction=TWO_DEG, speed=2.0, limits=LOW, guards=(0,) * 8):
        self.search = SearchCycle(SearchOrder(1, HOME, correction, speed, guards), limits)
        self.now_ns = 1_000_000_000
        self.ipoc = 1000
        self.beats = [-(1 << 62)] * 8
        self.correction = HOME
        self.unanswered = 0

    def cycle(self, *, stopped=False, gap=1, leave=False, joints=None, delay=None, telegram=None):
        self.now_ns += 4_000_000 * gap
        self.ipoc += 4 * gap
        self.unanswered += gap - 1
        count = self.unanswered if delay is None else delay
        plain = Telegram(str(self.ipoc), self.ipoc, joints or self.correction, count)
        telegram = replace(plain, **(telegram or {}))
        assert self.search.admit(telegram) is Admission.ANSWERABLE
        self.correction, stop = self.search.answer(telegram, self.now_ns, stopped, self.beats, leave=leave)
        return stop

    def run(self, cycles, **kwargs):
        for _ in range(cycles):
            self.cycle(**kwargs)


def test_an_order_beyond_the_limits_is_held_by_the_cycle_itself():
    rig = Rig(correction=axis2(6.0), speed=3.0)
    rig.run(800)
    assert rig.search.cause is Cause.LIMIT
    assert rig.search.detail == Limit.SPEED
    assert 0 < rig.correction[1] < 0.5
    assert rig.search.phase is Phase.LEAVING


def test_an_order_beyond_the_travel_is_held_at_its_limit():
    rig = Rig(correction=axis2(5.5))
    rig.run(1000)
    assert (rig.search.cause, rig.search.detail) == (Cause.LIMIT, Limit.CORRECTION)
    assert 4.98 < rig.correction[1] <= 5.0


def test_the_first_telegrams_are_answered_with_zero_until_the_cycle_is_known():
    rig = Rig()
    rig.run(7)
    assert rig.search.phase is Phase.LEARNING
    assert rig.correction == HOME
    rig.run(2)
    assert rig.correction[1] > 0


def test_while_answers_are_late_the_set_point_waits_and_then_goes_on_from_standstill():
    rig = Rig()
    rig.run(100, delay=5)
    before = rig.correction
    for late in range(6, 30):
        rig.cycle(delay=late)
        assert rig.correction == before
    rig.cycle(delay=29)
    assert 0 < rig.correction[1] - before[1] < 1e-4
    rig.run(100, delay=29)
    assert rig.correction[1] > before[1] + 0.5


def test_a_count_that_good_answers_do_not_set_back_falls_only_with_a_new_session():
    rig = Rig()
    rig.run(100, delay=5)
    ipoc = rig.ipoc + 4
    assert rig.search.admit(Telegram(str(ipoc), ipoc, rig.correction, 0)) is Admission.BEYOND
    assert rig.search.cause is Cause.RESTARTED


@pytest.mark.parametrize("resets", [False, True])
def test_after_one_answer_that_was_not_taken_it_is_repeated_and_the_path_begins_from_standstill(resets):
    """Of counts that a good answer sets back and of counts that it does not."""
    rig = Rig()
    rig.run(100, delay=0)
    before = rig.correction
    rig.cycle(delay=1)
    assert rig.correction == before
    rig.cycle(delay=0 if resets else 1)
    assert 0 < rig.correction[1] - before[1] < 1e-4
    rig.run(50, delay=0 if resets else 1)
    assert rig.correction[1] > before[1] + 0.2


def test_a_stop_while_the_last_answer_is_not_taken_goes_no_further():
    rig = Rig()
    rig.run(100, delay=0)
    before = rig.correction
    rig.cycle(delay=1, stopped=True)
    assert rig.correction == before
    assert rig.search.phase is Phase.SETTLING


def test_a_stop_while_settling_at_the_end_of_travel_is_a_contact():
    rig = Rig(correction=axis2(0.1))
    while rig.search.cause is Cause.NONE:
        rig.cycle()
    assert rig.search.cause is Cause.TRAVEL
    rig.cycle(stopped=True)
    assert rig.search.cause is Cause.STOPPED
    assert rig.search.stop_cycles == 1


@pytest.mark.parametrize(("gap", "admission"), [(0, "STALE"), (-25_000, "STALE"), (100, "ANSWERABLE"), (101, "BEYOND")])
def test_what_is_answered_is_newer_and_within_the_tolerance(gap, admission):
    rig = Rig()
    rig.run(100)
    ipoc = rig.ipoc + 4 * gap
    assert rig.search.admit(Telegram(str(ipoc), ipoc, rig.correction, gap - 1)).name == admission


def test_a_gap_beyond_the_tolerance_is_the_end_also_for_telegrams_that_would_fit_again():
    rig = Rig()
    rig.run(100)
    for ipoc in (rig.ipoc + 100_000, rig.ipoc + 4, rig.ipoc + 100_004):
        assert rig.search.admit(Telegram(str(ipoc), ipoc, rig.correction, None)).name == "BEYOND"
    assert (rig.search.cause, rig.search.phase, rig.search.detail) == (Cause.LOST, Phase.OVER, 100_000)


def sessions(after, **telegram):
    """Whether a search goes on with a telegram of a session that began `after` cycles after its last answer."""
    rig = Rig()
    rig.run(100, telegram={name: before for name, (before, _) in telegram.items()})
    ipoc = rig.ipoc + 4 * after
    again = Telegram(str(ipoc), ipoc, rig.correction, 0, 1e-4)
    admission = rig.search.admit(replace(again, **{name: now for name, (_, now) in telegram.items()}))
    assert (admission is Admission.ANSWERABLE) == (rig.search.cause is Cause.NONE)
    assert admission is Admission.ANSWERABLE or (rig.search.cause, rig.search.phase) == (Cause.RESTARTED, Phase.OVER)
    return admission is Admission.ANSWERABLE


@pytest.mark.parametrize("after", [3, 4, 50, 99])
def test_a_session_that_began_three_cycles_later_or_more_ends_the_search(after):
    assert not sessions(after)


def test_what_delay_cannot_show_the_programmed_joints_or_the_mark_show():
    """After one or two cycles: then the robot would move by the whole offset, in one cycle."""
    assert sessions(1)
    assert sessions(2)
    for after in (1, 2):
        assert not sessions(after, programmed=(HOME, axis2(0.5)))
        assert not sessions(after, mark=(3, 4))
        assert not sessions(after, mark=(3, 0))


def test_a_mark_that_stays_shows_that_telegrams_were_only_lost():
    assert sessions(80, mark=(3, 3))
    assert sessions(80, mark=(3, 3), delay=(None, None))


def test_programmed_joints_that_stay_confirm_no_session():
    assert not sessions(3, programmed=(HOME, HOME))


@pytest.mark.parametrize("after", [2, 99])
def test_without_delay_any_gap_ends_the_search(after):
    assert sessions(1, delay=(None, None))
    assert not sessions(after, delay=(None, None))


@pytest.mark.parametrize("missing", [2, 20, 99])
def test_after_a_gap_within_the_tolerance_the_path_goes_on_from_the_last_set_point(missing):
    rig = Rig()
    rig.run(100)
    before = rig.correction
    rig.cycle(gap=1 + missing)
    assert rig.correction == before
    rig.cycle()
    assert 0 < rig.correction[1] - before[1] < 1e-4


def test_a_robot_elsewhere_than_planned_is_left_before_it_has_moved():
    rig = Rig()
    assert rig.cycle(joints=axis2(0.2))
    assert (rig.search.cause, rig.correction) == (Cause.START, HOME)


@pytest.mark.parametrize("lost", [1, 2, 6])
def test_a_cycle_of_4_ms_is_not_taken_for_a_longer_one_where_telegrams_are_lost_from_the_start(lost):
    """A step for 12 ms in a cycle of 4 would be three times the speed."""
    rig = Rig()
    for number in range(30):
        rig.cycle(gap=1 + lost, delay=lost * number)
    assert not rig.search.timing.learnt
    for _ in range(10):
        rig.cycle(delay=lost * number)
    assert rig.search.timing.cycle_ns == 4_000_000


def test_a_robot_that_never_stands_still_is_left_after_a_second():
    rig = Rig(correction=axis2(0.1))
    shaking = itertools.cycle([axis2(0.1), axis2(0.2)])
    while rig.search.cause is Cause.NONE:
        rig.cycle()
    cycles = next(i for i in range(1000) if rig.cycle(joints=next(shaking)))
    assert 245 <= cycles <= 250


def test_a_process_that_must_leave_holds_and_asks_the_controller_to_leave():
    rig = Rig()
    rig.run(100)
    before = rig.correction[1]
    while not rig.cycle(leave=True):
        pass
    assert rig.search.cause is Cause.LEFT
    assert rig.correction[1] == pytest.approx(before + 0.004, abs=1e-6)


@given(st.lists(st.sampled_from([1, 1, 1, 1, 2, 5]), min_size=300, max_size=300), st.integers(0, 299))
def test_whatever_is_lost_and_whenever_it_stops_no_step_passes_the_speed(gaps, stop):
    rig = Rig()
    rig.run(9)
    for number, gap in enumerate(gaps):
        before = rig.correction
        rig.cycle(gap=gap, stopped=number >= stop)
        assert math.dist(before, rig.correction) <= 2.0 * CYCLE_S * (1 + 1e-6)
    assert rig.search.cause is Cause.STOPPED
    assert rig.search.missed == sum(gap - 1 for gap in gaps[: len(gaps)]) or rig.search.phase is Phase.LEAVING


def test_the_cycle_is_learnt_from_milliseconds_or_else_from_the_arrivals():
    for step, length_ns, learnt in ((4, 4_100_000, 4_000_000), (12, 11_800_000, 12_000_000), (1, 4_050_000, 4_000_000)):
        timing = CycleTiming()
        for number in range(8):
            timing.learn(1000 + step * number, length_ns * number)
        assert (timing.ipoc_step, timing.cycle_ns) == (step, learnt)


def test_a_telegram_left_over_from_before_does_not_spoil_the_learning():
    timing = CycleTiming()
    timing.learn(1000, 0)
    for number in range(8):
        timing.learn(900_000 + 4 * number, 50_000_000 + 4_000_000 * number)
    assert (timing.ipoc_step, timing.cycle_ns) == (4, 4_000_000)


def test_an_answer_s_delay_is_measured_from_the_fastest_telegram_and_forgets_drift():
    delay = AnswerDelay()
    for number in range(100_000):
        sent = number * 4_000_000
        arrival = sent + 5_000_000_000 + number * 400  # 100 ppm of drift: 40 ms in the end
        delay.arrived(sent, arrival)
        assert delay.of(sent, arrival + 200_000) <= 200_000 + 256 * 400
    assert delay.of(sent, arrival + 5_000_000) >= 5_000_000
