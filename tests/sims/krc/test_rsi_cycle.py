"""The sensor channel cycle by cycle: what is sent, what an answer does, what its absence does."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest

from sims import kernel
from sims.krc._rsi_exchange import AxisCorrection

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
ZERO = (0.0,) * 6
SHIPPED = Path(__file__).parents[3] / "procedures/cells/rsi_ethernet.xml"


def ipoc_of(telegram):
    return int(re.search(r"<IPOC>(\d+)</IPOC>", telegram)[1])


def axes_of(telegram, tag="AIPos"):
    return tuple(float(value) for value in re.findall(r'A\d="([^"]*)"', re.search(rf"<{tag} [^>]*>", telegram)[0]))


def delay_of(telegram):
    return int(re.search(r'<Delay D="(\d+)"/>', telegram)[1])


def a1(angle):
    return (angle, 0.0, 0.0, 0.0, 0.0, 0.0)


def ethernet(tmp_path, *changes):
    """The shipped configuration, changed."""
    text = SHIPPED.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "changed.xml").write_text(text)
    return tmp_path / "changed.xml"


def test_a_telegram_has_the_configurations_tags_in_its_order_and_ipoc_last(bench):
    pc = bench()
    pc.rsi_on()
    (telegram,) = pc.cycles(1)
    assert telegram.startswith('<Rob Type="KUKA"><RIst X="')
    assert re.findall(r"<(\w+)[ >]", telegram) == ["Rob", "RIst", "AIPos", "ASPos", "MACur", "Delay", "Tech", "IPOC"]
    assert re.search(r'<AIPos A1="0.0000" A2="-90.0000" A3="90.0000" A4="0.0000" A5="45.0000" A6="0.0000"/>', telegram)
    assert telegram.endswith("</IPOC></Rob>")


def test_rist_is_the_pose_of_the_nominal_robot_with_the_taught_tool(bench):
    pc = bench(errors={"geometry": 1, "tool": 1})
    pc.rsi_on()
    (telegram,) = pc.cycles(1)
    shown = [float(value) for value in re.findall(r'[XYZ]="([^"]*)"', telegram)]
    nominal = bench().world().true_tcp(HOME)
    assert shown == pytest.approx(nominal, abs=6e-5)


@pytest.mark.parametrize(("rsi", "text"), [({"precision": 1}, 'A1="0.3"'), ({}, 'A1="0.2700"')])
def test_numbers_have_the_decimals_of_precision(bench, rsi, text):
    pc = bench(rsi=rsi)
    pc.rsi_on()
    assert f"<AIPos {text} " in pc.ramp(a1(0.27))


@pytest.mark.parametrize("cycle_ms", [4, 12])
def test_ipoc_counts_the_milliseconds_of_the_cells_time(bench, cycle_ms):
    pc = bench(rsi={"cycle_ms": cycle_ms})
    pc.rsi_on()
    times, ipocs = [], []
    for _ in range(5):
        telegram = pc.telegram()
        times.append(pc.kernel.now)  # T stands still until the answer
        ipocs.append(ipoc_of(telegram))
        pc.answer(telegram)
    assert [b - a for a, b in itertools.pairwise(ipocs)] == [cycle_ms] * 4
    assert len({ipoc - time / 1e6 for ipoc, time in zip(ipocs, times, strict=True)}) == 1
    assert all(time % (cycle_ms * 1_000_000) == 0 for time in times)


def test_only_actual_values_move_under_correction_and_with_the_next_cycle(bench):
    pc = bench()
    pc.rsi_on()
    telegrams = pc.cycles(4, lambda i: a1(0.01 * (i + 1)))
    assert [axes_of(telegram)[0] for telegram in telegrams] == pytest.approx([0.0, 0.0, 0.01, 0.02])
    assert all(axes_of(telegram, "ASPos") == HOME for telegram in telegrams)


def test_encoders_and_lag_show_in_the_actual_values(bench):
    pc = bench(errors={"encoder": 1, "servo": 1})
    pc.rsi_on()
    telegrams = pc.cycles(60, lambda i: a1(0.004 * i))
    shown = [axes_of(telegram)[0] for telegram in telegrams]
    assert all(abs(value / 0.0005 - round(value / 0.0005)) < 1e-6 for value in shown)
    assert 0.004 * 57 - shown[-1] == pytest.approx(0.024 * 1.0, abs=0.001)


def test_a_correction_over_five_degrees_is_clamped_without_a_word(bench):
    pc = bench()
    pc.rsi_on()
    beyond = (7.0, -5.5, 0.0, 1.0, 0.0, 0.0)
    assert axes_of(pc.ramp(beyond, 300)) == pytest.approx((5.0, -95.0, 90.0, 1.0, 45.0, 0.0))
    assert pc.finish(beyond)[1] == 0


def test_the_overall_ceiling_is_six_degrees_on_any_axis_where_axiscorr_lets_more_through():
    widened = AxisCorrection(limit_deg=90.0)
    assert not widened.exceeded(widened.after(ZERO, (6.0, -6.0, 0.0, 0.0, 0.0, 0.0)))
    assert widened.exceeded(widened.after(ZERO, (0.0, 0.0, -6.001, 0.0, 0.0, 0.0)))
    assert not AxisCorrection().exceeded(AxisCorrection().after(ZERO, (50.0,) * 6))


def test_a_correction_over_the_ceiling_stops_rsi_with_its_message(bench):
    pc = bench(correction=AxisCorrection(limit_deg=90.0))
    pc.rsi_on()
    pc.ramp((0.0, 0.0, 6.0, 0.0, 0.0, 0.0))
    pc.cycles(1, (0.0, 0.0, 6.001, 0.0, 0.0, 0.0))
    number, code, joints, text = pc.reply()
    assert (number, code) == ("7", 31)
    assert "KSS29000" in text
    assert "Permissible overall correction exceeded: RSI is stopped" in text
    assert joints[2] == pytest.approx(96.0, abs=0.01)
    pc.state(['Prog="ERROR"', 'Msg="KSS29000'])


def test_stop_ends_rsi_where_the_robot_stands_and_the_program_takes_over_from_there(bench):
    pc = bench(errors={"servo": 1})
    pc.rsi_on()
    pc.cycles(50, lambda i: a1(0.005 * i))
    pc.state(['Prog="RSI"'])
    number, code, joints, _ = pc.finish(a1(0.245))
    assert (number, code) == ("7", 0)
    assert joints[0] == pytest.approx(0.245, abs=3e-4)
    pc.state(['Prog="READY"'])
    pc.rsi_on(8)
    (telegram,) = pc.cycles(1)
    assert axes_of(telegram, "ASPos") == pytest.approx(joints, abs=1e-4)
    assert pc.finish()[1] == 0


def test_after_stop_the_robot_runs_on_by_its_lag_and_no_further(bench):
    pc = bench(errors={"servo": 1})
    pc.rsi_on()
    speed = 1.0
    telegrams = pc.cycles(100, lambda i: a1(speed * 0.004 * i))
    at_stop = axes_of(telegrams[-1])[0]
    overtravel = pc.finish(a1(speed * 0.004 * 99))[2][0] - at_stop
    assert 0.0 < overtravel <= speed * (0.024 + 2 * 0.004)


@pytest.mark.long
def test_halt_ends_rsi_and_brakes(bench):
    pc = bench(errors={"servo": 1})
    pc.rsi_on()
    pc.cycles(50, lambda i: a1(0.02 * i))
    pc.telegram()
    pc.put('<Cmd Id="9" Op="HALT"/>')
    stopped, halted = pc.reply(), pc.reply()
    assert (stopped[:2], halted[:2]) == (("7", 30), ("9", 0))
    # braking from 5 deg/s at 385 deg/s² is 0.03°
    assert 0.0 < halted[2][0] < 0.02 * 50 + 0.05
    assert pc.ptp(HOME)[1] == 0


@pytest.mark.parametrize(("rsi", "ends"), [({}, True), ({"counter": "reset"}, False)])
def test_lost_cycles_add_up_or_are_forgiven_as_the_setting_says(bench, rsi, ends):
    pc = bench(rsi={"timeout_cycles": 5, **rsi})
    pc.rsi_on()
    for _ in range(6):
        telegram = pc.telegram()
        pc.answer(telegram, sentype="WRONG")
        if not (ends and delay_of(telegram) == 5):
            telegram = pc.telegram()
            pc.answer(telegram)
    if ends:
        number, code, _, text = pc.reply()
        assert (number, code) == ("7", 31)
        assert "KSS29002 Signal flow (running): Object ETHERNET1 returns error RSIBad" in text
        pc.state(['Prog="ERROR"', 'Msg="KSS29002'])
    else:
        (telegram,) = pc.cycles(1)
        assert delay_of(telegram) == 0
        assert pc.finish()[1] == 0


def test_exactly_one_cycle_more_than_tolerated_ends_rsi_and_no_telegram_follows(bench):
    pc = bench()
    pc.rsi_on()
    pc.cycles(101, sentype="WRONG")
    assert pc.reply()[1] == 31
    pc.udp.settimeout(0.2)
    with pytest.raises(TimeoutError):
        pc.telegram()
    assert pc.command("RSI")[1] == 12
    assert pc.command("RESET")[1] == 0


def test_an_answer_to_an_older_telegram_is_late_and_its_correction_is_not_taken(bench):
    pc = bench(rsi={"timeout_cycles": 3})
    pc.rsi_on()
    first = pc.telegram()
    pc.answer(first, a1(0.01))
    second = pc.telegram()
    pc.answer(second, a1(0.03), ipoc=ipoc_of(first))  # late: T still waits for the right one
    pc.answer(second, a1(0.02))
    third = pc.telegram()
    pc.answer(third, a1(0.02))
    fourth = pc.telegram()
    pc.answer(fourth, a1(0.02))
    assert [axes_of(telegram)[0] for telegram in (first, second, third, fourth)] == pytest.approx([0, 0, 0.01, 0.02])
    assert pc.finish(a1(0.02))[1] == 0


def test_an_ipoc_that_was_not_echoed_unchanged_counts_as_missing(bench):
    pc = bench(rsi={"timeout_cycles": 3})
    pc.rsi_on()
    for _ in range(4):
        telegram = pc.telegram()
        pc.answer(telegram, a1(1.0), ipoc=ipoc_of(telegram) + 4)
    assert pc.reply()[1:3] == (31, HOME)


@pytest.mark.long
def test_a_pc_that_is_always_one_telegram_behind_is_counted_late_to_the_end(bench):
    pc = bench(rsi={"timeout_cycles": 20})
    pc.rsi_on()
    for _ in range(21):
        telegram = pc.telegram()
        pc.answer(telegram, a1(1.0), ipoc=ipoc_of(telegram) - 4)
    assert pc.reply()[1:3] == (31, HOME)


def test_a_pc_that_was_taken_for_dead_is_waited_for_again_when_it_speaks(bench, monkeypatch):
    pc = bench(rsi={"timeout_cycles": 1_000_000})
    with monkeypatch.context() as impatient:
        impatient.setattr(kernel, "PATIENCE_NS", 200_000_000)
        pc.rsi_on()
        pc.telegram()
        while not pc.kernel.is_dead("rsi"):
            telegram = pc.telegram()  # none before the patience is over
    pc.answer(telegram)
    before = delay_of(pc.cycles(400)[-1])
    assert delay_of(pc.cycles(50)[-1]) == before
    assert pc.finish()[1] == 0


@pytest.mark.realtime
def test_in_real_time_an_answer_after_the_next_telegram_is_late(bench):
    pc = bench(mode="realtime", rsi={"timeout_cycles": 1_000_000})
    pc.rsi_on()
    first = pc.telegram()
    second = pc.telegram()  # comes without an answer to the first
    pc.answer(first, a1(1.0))
    pc.answer(second)
    third = pc.telegram()
    assert delay_of(second) == 1 <= delay_of(third)
    assert axes_of(third)[0] == 0.0
    pc.put('<Cmd Id="9" Op="HALT"/>')
    assert pc.reply()[:2] == ("7", 30)


def test_motor_currents_are_the_true_ones_with_the_noise_of_one_telegram(bench):
    pc = bench()
    pc.rsi_on()
    currents = [axes_of(telegram, "MACur") for telegram in pc.cycles(100)]
    means = [sum(axis) / 100 for axis in zip(*currents, strict=True)]
    assert means == pytest.approx(pc.world().holding_currents(HOME), abs=4 * 0.02 / 10)
    scatter = [sum((a - b) ** 2 for a, b in zip(row, means, strict=True)) for row in currents]
    assert sum(scatter) / 600 == pytest.approx(0.02**2, rel=0.25)
    assert all(round(current * 1e3) == pytest.approx(current * 1e3) for row in currents for current in row)
    assert pc.finish()[1] == 0


def test_a_pc_that_says_nothing_is_counted_late_to_the_end(bench, monkeypatch):
    monkeypatch.setattr(kernel, "PATIENCE_NS", 200_000_000)
    pc = bench(rsi={"timeout_cycles": 20})
    pc.rsi_on()
    assert pc.reply()[1] == 31  # once its patience is over, T runs on without it


def test_a_missed_cycle_keeps_the_correction_with_holdon_1_and_resets_it_with_0(bench, tmp_path):
    plain = ethernet(tmp_path, ('INDX="1" HOLDON="1"', 'INDX="1" HOLDON="0"'))
    for path, expected in ((None, 0.03), (plain, 0.0)):
        pc = bench(ethernet=path)
        pc.rsi_on()
        held = (0.03, 0.03, 0.0, 0.0, 0.0, 0.0)
        pc.cycles(3, held)
        pc.cycles(3, sentype="WRONG")
        (telegram,) = pc.cycles(1, held)
        assert axes_of(telegram)[:2] == pytest.approx((expected, -89.97))
        assert pc.finish(held)[1] == 0


def test_with_onlysend_the_controller_streams_without_an_answer_until_halted(bench, tmp_path):
    pc = bench(ethernet=ethernet(tmp_path, ("FALSE", "TRUE")), rsi={"timeout_cycles": 3})
    pc.rsi_on()
    assert [delay_of(pc.telegram()) for _ in range(20)] == [0] * 20
    pc.put('<Cmd Id="9" Op="HALT"/>')
    assert pc.reply()[:2] == ("7", 30)


def test_a_set_point_past_an_axis_limit_stops_the_controller(bench):
    pc = bench()
    pc.ptp((150.0, -90.0, 90.0, 0.0, 45.0, 0.0))  # away from the spheres
    pc.ptp((150.0, 64.0, 0.0, 0.0, 45.0, 0.0))
    pc.rsi_on()
    number, code, _, text = pc.until_reply(lambda cycle: (0.0, 0.008 * cycle, 0.0, 0.0, 0.0, 0.0))
    assert (number, code) == ("7", 31)
    assert "KSS01211 STOP due to software limit switch +A2" in text


def test_a_controller_that_was_not_told_where_the_pc_is_says_so(bench):
    pc = bench()
    pc.krc._link.close()
    number, code, _, text = pc.command("RSI", 7)
    assert (number, code) == ("7", 31)
    assert "General error: ETHERNET1" in text


def test_stalled_answers_are_lost_and_dropped_telegrams_never_come(bench):
    pc = bench(faults=[{"fault": "rsi.stall", "search": 1, "after_ms": 10, "for_ms": 12},
                       {"fault": "rsi.drop", "search": 1, "after_ms": 42, "for_ms": 8}])  # fmt: skip
    pc.rsi_on()
    telegrams = pc.cycles(20)
    assert [b - a for a, b in zip(map(ipoc_of, telegrams), map(ipoc_of, telegrams[1:]), strict=False)].count(12) == 1
    assert delay_of(telegrams[-1]) == 3 + 2
    assert pc.finish()[1] == 0


def test_a_silent_controller_is_on_but_sends_nothing_until_halted(bench):
    pc = bench(faults=[{"fault": "rsi.silent", "search": 1}], rsi={"timeout_cycles": 3})
    pc.rsi_on()
    pc.udp.settimeout(0.3)
    with pytest.raises(TimeoutError):
        pc.telegram()
    assert pc.command("HALT", 9)[:2] == ("7", 30)
    assert pc.reply()[:2] == ("9", 0)


def test_a_controller_with_another_sentype_takes_no_answer(bench):
    pc = bench(faults=[{"fault": "rsi.sentype", "at_ms": 0}], rsi={"timeout_cycles": 3})
    pc.rsi_on()
    pc.cycles(4, a1(1.0))
    assert pc.reply()[1:3] == (31, HOME)


def mark_of(telegram):
    return tuple(float(value) for value in re.findall(r'C2[12]="([^"]*)"', telegram))


@pytest.mark.parametrize(("rsi", "same"), [({}, True), ({"port": "new"}, False)])
@pytest.mark.parametrize(("cycles", "after"), [({}, 3), ({"restart_cycles": 1000}, 1000)])
def test_rsi_that_is_switched_off_and_on_goes_on_counting_with_a_delay_and_a_zero_of_its_own(
    bench, rsi, same, cycles, after
):
    restart = {"fault": "rsi.restart", "search": 1, "after_ms": 200}
    pc = bench(rsi={**rsi, **cycles}, faults=[restart])
    pc.rsi_on()
    before = pc.ramp(a1(0.3))
    ports = [pc.robot[1]]
    while mark_of(again := pc.telegram()) == mark_of(before):
        pc.answer(before := again, a1(0.3))
    assert ipoc_of(again) - ipoc_of(before) == 4 * (1 + after)
    assert (delay_of(again), mark_of(before), mark_of(again)) == (0, (1, -1), (2, -2))
    assert axes_of(before, "ASPos") == HOME
    assert axes_of(again, "ASPos") == pytest.approx(axes_of(again), abs=1e-3), "its zero is where the robot stands"
    assert (pc.robot[1] in ports) is same


def test_a_program_that_marks_no_session_sends_zeros(bench):
    pc = bench(rsi={"mark": "none"})
    pc.rsi_on()
    assert mark_of(pc.telegram()) == (0, 0)
