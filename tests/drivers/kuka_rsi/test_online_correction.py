"""What an on-line correction does in trouble: it fades to zero, is held, or goes on, as stated, and never leaps."""

from __future__ import annotations

import itertools
import math
import os
import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellctl.clock import WallClock
from cellctl.devices import Address, Surroundings
from cellctl.devices.cell import ONLINE_CORRECTION_DEG
from drivers.kuka_rsi.cyclic.limits import CorrectionMotion, Limit, OnlineLimits, online_limit_errors
from drivers.kuka_rsi.cyclic.online_block import OnlineSlot, pack
from drivers.kuka_rsi.cyclic.online_correction import OnlineCorrection
from drivers.kuka_rsi.cyclic.session import DEFAULT_TOLERANCE, Admission, Cause, InterpolationCycle, Phase, SearchOrder
from drivers.kuka_rsi.cyclic.shared_block import SharedBlock
from drivers.kuka_rsi.cyclic.telegram import Telegram
from drivers.kuka_rsi.description import findings
from tests.helpers.krc import wavy_model

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
LIMITS = OnlineLimits()
CYCLE_S = 0.004
ENGINE_NS = 250_000_000
NOW = -1


class Controller:
    """A controller that runs its own program and adds the correction of each answer; degrees."""

    def __init__(self, model=1.0, limits=LIMITS, follows=1.0, sums_up=False, **region):
        self.block, fd = SharedBlock.create()
        os.close(fd)
        self.region = region
        self.place(model)
        self.limits = limits
        order = SearchOrder(1, HOME, (0.0,) * 6, 1.0, (ENGINE_NS,) + (0,) * 7)
        self.task = OnlineCorrection(order, limits, self.block.online)
        self.programmed, self.velocity = HOME, (0.0,) * 6
        self.follows, self.sums_up = follows, sums_up
        self.sent, self.offset = [(0.0,) * 6], (0.0,) * 6
        self.ipoc = self.now_ns = self.late = 0
        self.engine_alive = self.engine_was_alive_ns = True
        self.stopped = self.leave = False
        self.cycles_apart = 1

    def place(self, size):
        return self.block.online.place_model(pack(wavy_model(size, **self.region)))

    def run(self, seconds, answers_lost=False, **without):
        for _ in range(round(seconds / CYCLE_S)):
            self.now_ns += self.cycles_apart * 4_000_000
            self.ipoc += self.cycles_apart * 4
            self.late += answers_lost + self.cycles_apart - 1
            moved = zip(self.programmed, self.velocity, strict=True)
            self.programmed = tuple(at + CYCLE_S * by for at, by in moved)
            joints = tuple(a + self.follows * b for a, b in zip(self.programmed, self.offset, strict=True))
            telegram = Telegram(str(self.ipoc), self.ipoc, joints, self.late, 1e-4, None, self.programmed)
            telegram = replace(telegram, **without)
            if self.task.admit(telegram) is not Admission.ANSWERABLE:
                continue
            if self.engine_alive:
                self.beat_ns = self.now_ns
            beats = [self.beat_ns] + [0] * 7
            correction, stop = self.task.answer(telegram, self.now_ns, self.stopped, beats, leave=self.leave)
            assert not stop
            if not answers_lost:
                self.sent.append(correction)
                old = self.offset if self.sums_up else (0.0,) * 6
                self.offset = tuple(a + b for a, b in zip(old, correction, strict=True))
        return self

    @property
    def last(self):
        return self.sent[-1]

    def never_leapt(self):
        steps = [tuple(b - a for a, b in zip(*pair, strict=True)) for pair in itertools.pairwise(self.sent)]
        assert max(math.hypot(*step) for step in steps) <= self.limits.online_rate_deg_s * CYCLE_S + 3e-6
        assert max(abs(axis) for sent in self.sent for axis in sent) <= self.limits.online_correction_deg
        return True


def test_it_begins_at_zero_and_reaches_the_models_correction():
    krc = Controller().run(3)
    assert krc.sent[1:8] == [(0.0,) * 6] * 7
    assert max(map(abs, krc.last)) > 0.02
    assert krc.sent[-100] == krc.last
    assert krc.task.phase is Phase.MOVING
    assert krc.never_leapt()


def test_on_request_it_fades_to_zero_and_stays_there():
    krc = Controller().run(2)
    krc.block.online.words[OnlineSlot.RAMP_OUT] = 1
    krc.velocity = (20.0, 10.0, -10.0, 0.0, 5.0, 0.0)
    krc.run(2)
    assert krc.task.phase is Phase.LEAVING
    assert set(krc.sent[-50:]) == {(0.0,) * 6}
    assert krc.never_leapt()


def test_a_silent_engine_lets_it_fade_to_zero():
    krc = Controller().run(2)
    krc.engine_alive = False
    krc.run(3)
    assert (krc.task.cause, krc.last) == (Cause.GUARD, (0.0,) * 6)
    assert krc.never_leapt()


def test_the_end_of_its_process_lets_it_fade_to_zero_within_the_time_that_the_process_waits():
    krc = Controller(model=12.0).run(5)
    assert max(map(abs, krc.last)) > 0.45
    krc.leave = True
    krc.run(2.9)
    assert (krc.task.cause, krc.last) == (Cause.LEFT, (0.0,) * 6)
    assert krc.never_leapt()


def test_a_stop_holds_it_as_it_is():
    krc = Controller().run(0.3)
    krc.stopped = True
    krc.run(0.2)
    held = krc.last
    krc.run(1)
    assert krc.task.cause is Cause.STOPPED
    assert krc.last == held != (0.0,) * 6
    assert krc.never_leapt()


def test_rsi_that_is_lost_is_not_answered_any_more():
    krc = Controller().run(2)
    before = len(krc.sent)
    krc.ipoc += 101 * 4
    krc.run(1)
    assert krc.task.cause is Cause.LOST
    assert len(krc.sent) == before


def test_lost_answers_are_repeated_and_it_goes_on_from_standstill():
    krc = Controller().run(0.5)
    held = krc.last
    krc.run(0.3, answers_lost=True)
    krc.run(2 * CYCLE_S)
    assert math.dist(krc.last, held) <= LIMITS.online_rate_deg_s * CYCLE_S
    assert krc.run(2).never_leapt()


def test_answers_that_are_never_known_to_be_taken_hold_it_and_end_it_as_soon_as_they_are_again():
    krc = Controller().run(0.5)
    krc.cycles_apart = 3
    krc.run(DEFAULT_TOLERANCE * CYCLE_S)
    held = krc.last
    assert (krc.task.cause, krc.sent[-DEFAULT_TOLERANCE]) == (Cause.NONE, held)
    krc.run(2 * CYCLE_S)
    assert (krc.task.cause, krc.last) == (Cause.NOT_TAKEN, held)
    krc.cycles_apart = 1
    krc.run(2)
    assert krc.last == (0.0,) * 6 != held
    assert krc.never_leapt()


@pytest.mark.parametrize("marks", [(0, 0), (6, 7)])
@pytest.mark.parametrize("after", [1, 2])
def test_rsi_that_restarts_after_one_or_two_cycles_leaps_by_the_correction_at_most_and_with_a_mark_not_at_all(
    after, marks
):
    """Delay cannot show it: 0 late answers are those of a session of one cycle. Its zero is where the robot stands."""
    krc = Controller(model=12.0).run(3, mark=marks[0])
    held, krc.cycles_apart = krc.last, after
    krc.programmed = tuple(a + b for a, b in zip(krc.programmed, held, strict=True))
    krc.offset, answered = (0.0,) * 6, len(krc.sent)
    krc.late = 1 - after  # `run` counts the cycles between as late; the new session has none
    krc.run(CYCLE_S, mark=marks[1])
    leap = max(map(abs, krc.offset))
    assert (len(krc.sent) > answered) == (leap > 0) == (marks == (0, 0))
    assert leap <= LIMITS.online_correction_deg


def test_a_new_model_takes_over_without_a_leap():
    krc = Controller(model=0.5).run(2)
    before, version = krc.last, krc.place(1.0)
    krc.run(2)
    assert krc.block.online.status().taken == version
    assert krc.last == pytest.approx(tuple(2 * axis for axis in before), rel=0.1, abs=1e-3)
    assert krc.never_leapt()


def test_a_torn_model_is_refused_and_the_last_one_stays():
    krc = Controller().run(2)
    before, taken = krc.last, krc.block.online.status().taken
    version = krc.place(2.0)
    krc.block.online.reals[OnlineSlot.HALVES + 3 + 20] += 1.0
    krc.run(1)
    status = krc.block.online.status()
    assert (status.taken, status.refused) == (taken, version)
    assert krc.last == before


def test_without_any_valid_model_nothing_is_corrected():
    krc = Controller()
    krc.block.online.reals[OnlineSlot.HALVES + 16_387 + 3 + 20] += 1.0
    krc.task = OnlineCorrection(krc.task.order, LIMITS, krc.block.online)
    krc.run(1)
    assert krc.task.cause is Cause.MODEL
    assert set(krc.sent) == {(0.0,) * 6}


def test_outside_the_measured_region_it_fades_to_zero_and_comes_back():
    krc = Controller(span_deg=100.0).run(2)
    krc.velocity = (30.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    krc.run(5)
    assert krc.programmed[0] > 102
    assert krc.last == (0.0,) * 6
    krc.velocity = (-30.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    krc.run(4)
    assert max(map(abs, krc.last)) > 0.02
    assert krc.task.phase is Phase.MOVING
    assert krc.block.online.status().outside > 100
    assert krc.never_leapt()


def test_at_its_limit_it_is_cut_in_proportion_and_counted():
    krc = Controller(model=12.0).run(4)
    small = Controller(model=0.1).run(4)
    assert max(map(abs, krc.last)) == pytest.approx(LIMITS.asked_deg(CYCLE_S), abs=1e-5)
    largest = max(range(6), key=lambda axis: abs(small.last[axis]))
    assert abs(krc.last[largest]) == max(map(abs, krc.last))
    assert krc.block.online.status().limited > 500
    assert krc.never_leapt()


def test_telegrams_in_another_cycle_than_the_stated_one_are_answered_with_zero():
    krc = Controller()
    krc.task = OnlineCorrection(krc.task.order, LIMITS, krc.block.online, cycle=InterpolationCycle.IPO)
    krc.run(2)
    assert (krc.task.cause, krc.task.detail, krc.task.phase) == (Cause.CYCLE, 4_000_000, Phase.LEAVING)
    assert set(krc.sent) == {(0.0,) * 6}


@pytest.mark.parametrize("without", [{"programmed": None}, {"delay": None}])
def test_a_telegram_without_programmed_joints_or_late_count_ends_it(without):
    krc = Controller().run(2)
    krc.run(2, **without)
    assert (krc.task.cause, krc.last) == (Cause.UNKNOWN, (0.0,) * 6)
    assert krc.never_leapt()


@pytest.mark.parametrize("wrong", [{"follows": 0.0}, {"follows": -1.0}, {"sums_up": True}])
def test_axes_that_do_not_follow_while_the_program_stands_end_it(wrong):
    krc = Controller(model=3.0, **wrong).run(4)
    assert (krc.task.cause, krc.last) == (Cause.BEHIND, (0.0,) * 6)
    assert max(map(abs, krc.offset)) < 0.5
    assert krc.never_leapt()


@pytest.mark.parametrize(
    ("limits", "named"),
    [
        ({"online_correction_deg": 2.5}, "above the ceiling of 2"),
        ({"online_rate_deg_s": 0.0}, "must be a positive number"),
        ({"online_rate_deg_s": 2.0}, "stops within 0.448 deg only"),
        ({"online_correction_deg": 2e-4, "online_rate_deg_s": 0.04, "online_acceleration_deg_s2": 20}, "stops within"),
        ({"online_speed": 1.0}, "unknown robot limit"),
    ],
)
def test_limits_that_do_not_hold_are_refused_with_the_reason(limits, named):
    (found,) = online_limit_errors(limits).values()
    assert named in found
    with pytest.raises(ValueError, match=named):
        OnlineLimits.from_settings(limits)


def test_the_limit_that_a_campaign_reads_from_a_cell_file_without_it_is_the_drivers():
    assert OnlineLimits().online_correction_deg == ONLINE_CORRECTION_DEG


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    rate=st.floats(1e-4, 2.0),
    acceleration=st.floats(0.01, 20.0),
    most=st.floats(1e-4, 2.0),
    cycle_s=st.sampled_from([0.004, 0.012]),
    seed=st.integers(0, 99),
)
def test_whatever_the_limits_are_no_step_passes_one_and_zero_is_reached(rate, acceleration, most, cycle_s, seed):
    try:
        limits = OnlineLimits(most, rate, acceleration)
    except ValueError:
        return
    draw, motion, asked = random.Random(seed), CorrectionMotion(limits, cycle_s), limits.asked_deg(cycle_s)
    for _ in range(60):
        wanted = tuple(draw.choice([-asked, 0.0, draw.uniform(-asked, asked), asked]) for _ in range(6))
        for _ in range(draw.choice([1, 3, 40])):
            assert motion.follow(wanted) is Limit.NONE
        if draw.random() < 0.1:
            motion.stood()
    distance = math.hypot(*motion.sent)
    cycles = (distance / rate + 2 * rate / acceleration + math.sqrt(2 * distance / acceleration)) / cycle_s
    for _ in range(2 * math.ceil(cycles) + 10):
        assert motion.follow((0.0,) * 6) is Limit.NONE
    assert max(map(abs, motion.sent)) <= 1e-6


def test_a_rate_that_is_reached_within_a_cycle_is_kept():
    krc = Controller(model=0.05, limits=OnlineLimits(online_rate_deg_s=0.008)).run(8)
    assert (krc.task.cause, krc.task.phase) == (Cause.NONE, Phase.MOVING)
    assert krc.sent[-100] == krc.last != (0.0,) * 6
    assert krc.never_leapt()


def test_a_correction_beyond_what_axiscorr_lets_through_is_found_before_anything_is_opened(tmp_path):
    address = Address.parse("kuka+rsi://127.0.0.1:0?ethernet=rsi.xml&eki=127.0.0.1:54600")
    limits = {"correction_deg": 1.0, "online_correction_deg": 1.5}
    (found,) = findings(address, Surroundings(WallClock(), tmp_path, limits))
    assert (found.limit, found.warning) == ("online_correction_deg", False)
    assert "above correction_deg 1" in found.what


def test_a_model_whose_correction_is_over_the_limit_everywhere_is_refused_before_any_cycle():
    krc = Controller(model=40.0)
    assert krc.task.cause is Cause.OVER_LIMIT
    assert not any(any(sent) for sent in krc.run(3).sent)
    assert Controller(model=3.0).task.cause is Cause.NONE
