"""A set-point that leaps is a fault of the drives; what an honest search asks for never is."""

from __future__ import annotations

import itertools
import re

import pytest

from sims.krc._rsi_exchange import AxisCorrection
from sims.krc._servo import DriveMonitor

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
KR5 = (154.0, 154.0, 228.0, 343.0, 384.0, 721.0)
"""Highest speeds, deg/s (procedures/robots/kr5_r1400.yaml)."""
AXES = range(6)


def along(axis, places):
    """Set-points of one axis alone."""
    return [tuple(place if i == axis else 0.0 for i in AXES) for place in places]


def messages(set_points, cycle_s=0.004):
    monitor = DriveMonitor(KR5, cycle_s)
    rows = [set_points[0]] * 2 + set_points
    return {monitor.message(*three) for three in zip(rows, rows[1:], rows[2:], strict=False)}


def a1(angle):
    return (angle, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("cycle_s", [0.004, 0.012])
def test_a_search_at_5_deg_s_and_its_stop_in_two_telegrams_are_no_fault_on_any_axis(axis, cycle_s):
    full = 5.0 * cycle_s
    speeding_up = [50.0 * cycle_s**2 * i for i in range(1, round(0.1 / cycle_s))]
    steps = [0.0, *speeding_up, full, full, full / 2, 0.0, 0.0]
    assert messages(along(axis, list(itertools.accumulate(steps))), cycle_s) == {""}


def test_one_lost_answer_at_5_deg_s_held_and_caught_up_is_no_fault():
    full = 0.02
    for after in ([0.0, full, full], [0.0, 2 * full, full], [0.0, 0.0, 0.0]):
        places = list(itertools.accumulate([0.0, full / 2, full, full, *after]))
        assert messages(along(0, places)) == {""}


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("leap", [0.25, -0.25, 1.0])
def test_a_leap_of_a_quarter_degree_in_4_ms_is_a_fault_on_every_axis_from_rest_and_in_motion(axis, leap):
    for speed in (0.0, 5.0):
        moving = [speed * 0.004 * i for i in range(10)]
        found = messages(along(axis, [*moving, moving[-1] + leap])) - {""}
        assert found
        assert all(text.endswith(f" A{axis + 1}") for text in found)


def test_the_velocity_is_monitored_at_110_percent_of_an_axis_highest_speed():
    # slowly up to speed, then steady: 1.09 and 1.11 times 154 deg/s
    for share, expected in ((1.09, {""}), (1.11, {"", "KSS01102 Command velocity A1"})):
        steps = [min(i / 20, 1.0) * share * 154.0 * 0.004 for i in range(40)]
        assert messages(along(0, list(itertools.accumulate(steps)))) == expected


@pytest.mark.parametrize(("leap", "message"), [(2.0, "KSS01102 Command velocity A1"), (0.3, "Command acceleration A1")])
def test_a_pc_whose_correction_leaps_gets_the_controllers_fault_and_the_robot_does_not_follow(bench, leap, message):
    pc = bench(errors={"servo": 1})
    pc.rsi_on()
    pc.cycles(20)
    number, code, joints, text = pc.until_reply(lambda cycle: a1(leap))
    assert (number, code) == ("7", 31)
    assert f'Text="{message}"' in text
    assert joints == pytest.approx(HOME, abs=1e-3)
    pc.state(['Prog="ERROR"', f'Msg="{message}"'])
    assert pc.command("RSI")[1] == 12
    assert pc.command("RESET")[1] == 0
    assert pc.ptp(HOME)[1] == 0


def test_a_leap_in_motion_brakes_the_robot(bench):
    pc = bench(errors={"servo": 1})
    pc.rsi_on()
    pc.cycles(100, lambda i: a1(0.02 * min(i, 10) / 10 * i))
    _, code, joints, _ = pc.until_reply(lambda cycle: a1(0.0))
    assert code == 31
    # the axis was 24 ms behind the set-point; it brakes from 5 deg/s at 385 deg/s²
    assert joints[0] == pytest.approx(0.02 * 99 - 5.0 * 0.024 + 5.0**2 / (2 * 385.0), abs=2e-3)


def test_the_set_point_that_stop_holds_is_not_monitored(bench):
    """ExitMoveCorr is the controller's own braking, whatever the speed."""
    pc = bench(errors={"servo": 1})
    pc.rsi_on()
    pc.cycles(100, lambda i: a1(0.0008 * i * i / 2))
    number, code, _, _ = pc.finish(a1(0.0008 * 99 * 100 / 2))
    assert (number, code) == ("7", 0)


def test_an_absolute_correction_that_falls_back_to_zero_with_holdon_0_is_a_leap(bench, tmp_path, request):
    text = (request.config.rootpath / "procedures/cells/rsi_ethernet.xml").read_text()
    (tmp_path / "e.xml").write_text(re.sub(r'(TAG="AK.*)HOLDON="1"', r'\1HOLDON="0"', text))
    pc = bench(ethernet=tmp_path / "e.xml", correction=AxisCorrection())
    pc.rsi_on()
    pc.ramp(a1(1.0))
    pc.cycles(1, sentype="WRONG")
    _, code, _, text = pc.until_reply(a1(1.0))
    assert code == 31
    assert "KSS01102 Command velocity A1" in text
