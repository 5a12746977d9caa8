"""Motions against closed forms: profiles, straight lines, stops, limits; and what the arm does behind the target."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import degrees, dist, exp, radians

import numpy as np
import pytest

from sims.ur._modes import RuntimeState, SafetyMode
from sims.ur._poses import matrix_of
from sims.ur._profiles import Trapezoid, followed
from tests.sims.ur.conftest import CELL

HOME = [radians(angle) for angle in (0, -90, 90, -90, -90, 0)]


def joints(*changes):
    return str([q + change for q, change in zip(HOME, changes, strict=True)])


def watched(begun, body, most=20.0):
    """(time, target, speed, actual, actual speed) in each cycle of a program, and until the arm stands."""
    found = []
    earlier = begun.controller.on_cycle

    def look(number):
        motion = begun.motion
        found.append(
            (begun.controller.timestamp(), motion.target, motion.speed, motion.actual(), motion.actual_speed())
        )
        return earlier(number)

    begun.controller.on_cycle = look
    begun.run(body)
    begun.settle()
    assert found[-1][0] - found[0][0] < most
    return found


@pytest.mark.parametrize(
    ("way", "v", "a", "seconds", "expected"),
    [
        (1.0, 0.5, 1.0, 0.0, 1.0 / 0.5 + 0.5 / 1.0),
        (0.1, 5.0, 1.0, 0.0, 2.0 * (0.1 / 1.0) ** 0.5),
        (1.0, 1.0, 1.0, 3.0, 3.0),
    ],
)
def test_a_trapezoid_takes_the_time_of_its_closed_form(way, v, a, seconds, expected):
    profile = Trapezoid.of(way, v, a, seconds)
    assert profile.seconds == pytest.approx(expected)
    times = np.linspace(0.0, expected, 2001)
    shares = np.array([profile.at(t) for t in times])
    speed = np.gradient(shares, times) * way
    assert shares[0] == 0.0
    assert shares[-1] == 1.0
    assert speed.min() > -1e-6
    if not seconds:
        assert speed.max() <= v + 1e-6
        assert np.abs(np.gradient(speed, times)).max() < a * 1.01


def test_a_joint_behind_a_ramp_has_the_steady_lag_and_the_decay_of_its_filter():
    omega, h, rate = 500.0, 0.002, 0.7
    x, v, u = 0.0, 0.0, 0.0
    for _ in range(200):
        x, v = followed(x, v, u, u + rate * h, omega, h)
        u += rate * h
    assert (u - x, v) == (pytest.approx(2.0 * rate / omega), pytest.approx(rate))
    x, v = followed(1.0, 0.0, 0.0, 0.0, omega, h)
    assert x == pytest.approx((1.0 + omega * h) * exp(-omega * h))


def test_movej_goes_in_proportion_at_the_leading_joint_s_speed(bench):
    seen = watched(bench(errors={}), f"movej({joints(0.8, -0.4, 0, 0, 0, 0.2)}, a=2, v=0.5)")
    speeds = np.array([speed for _, _, speed, _, _ in seen])
    assert np.abs(speeds).max(axis=0) == pytest.approx([0.5, 0.25, 0, 0, 0, 0.125], rel=1e-3)
    moving = [time for time, _, speed, _, _ in seen if any(speed)]
    assert moving[-1] - moving[0] == pytest.approx(0.8 / 0.5 + 0.5 / 2, abs=0.01)
    targets = np.array([target for _, target, _, _, _ in seen]) - HOME
    assert np.allclose(targets[:, 1], -targets[:, 0] / 2)
    assert seen[-1][3] == pytest.approx([q + c for q, c in zip(HOME, (0.8, -0.4, 0, 0, 0, 0.2), strict=True)])


def test_the_time_of_movej_wins_over_speed_and_acceleration(bench):
    seen = watched(bench(errors={}), f"movej({joints(0.4, 0, 0, 0, 0, 0)}, a=0.1, v=0.1, t=2)")
    moving = [time for time, _, speed, _, _ in seen if any(speed)]
    assert moving[-1] - moving[0] == pytest.approx(2.0, abs=0.01)


def test_movel_is_straight_at_its_speed_and_turns_about_one_axis(bench):
    begun = bench(errors={}, calibration_knows=0.0)
    start = begun.motion.model.tcp(tuple(HOME), begun.motion.tool)
    goal = (start[0] + 0.1, start[1] + 0.05, start[2] - 0.1, *start[3:])
    seen = watched(begun, f"movel(p{list(goal)}, a=1, v=0.1)")
    path = np.array([begun.motion.model.tcp(target, begun.motion.tool)[:3] for _, target, _, _, _ in seen])
    along = np.array(goal[:3]) - start[:3]
    off = np.cross(path - start[:3], along / np.linalg.norm(along))
    assert np.linalg.norm(off, axis=1).max() < 1e-8
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1) / 0.002
    assert steps.max() == pytest.approx(0.1, rel=1e-3)
    assert np.allclose(begun.motion.model.tcp(begun.motion.actual(), begun.motion.tool), goal, atol=1e-6)


def test_the_tool_is_what_movel_moves(bench):
    begun = bench(errors={})
    pose = begun.run("set_tcp(p[0, 0, 0.2, 0, 0, 0])\nmovel(pose_add(get_target_tcp_pose(), p[0, 0, 0.05, 0, 0, 0]))")
    assert pose == []
    flange = begun.motion.model.flange(begun.motion.target)
    tip = (flange @ matrix_of((0, 0, 0.2, 0, 0, 0)))[:3, 3]
    home = begun.motion.model.flange(tuple(HOME)) @ matrix_of((0, 0, 0.2, 0, 0, 0))
    assert tip - home[:3, 3] == pytest.approx([0, 0, 0.05], abs=1e-8)


def test_speedl_moves_the_tcp_at_its_speed_until_stopl(bench):
    begun = bench(errors={})
    before = begun.motion.model.tcp(tuple(HOME), begun.motion.tool)
    log = begun.run(
        "speedl([0, 0, -0.05, 0, 0, 0], 0.5)\nspeedl([0, 0, -0.05, 0, 0, 0], 0.5, t=1)\n"
        "textmsg(get_target_tcp_speed()[2])\nstopl(0.5)"
    )
    assert float(log[0]) == pytest.approx(-0.05, rel=1e-3)
    begun.settle()
    after = begun.motion.model.tcp(begun.motion.actual(), begun.motion.tool)
    assert after[:2] == pytest.approx(before[:2], abs=1e-5)
    # ramp, a second, ramp
    assert before[2] - after[2] == pytest.approx(0.05 * (1.0 + 0.05 / 0.5), abs=2e-4)


def test_speedj_for_a_time_and_stopj(bench):
    seen = watched(bench(errors={}), "speedj([0.2, 0, 0, 0, 0, -0.1], 1, t=0.5)\nstopj(1)")
    assert seen[-1][1][0] == pytest.approx(0.2 * 0.5, abs=1e-3)
    assert max(speed[0] for _, _, speed, _, _ in seen) == pytest.approx(0.2)


def test_a_speed_that_no_command_goes_on_with_is_braked(bench):
    begun = bench(errors={})
    begun.run("speedj([0.5, 0, 0, 0, 0, 0], 5, t=0.2)\nsleep(0.3)\ntextmsg(is_steady())")
    assert begun.log == ["True"]


def test_servoj_follows_a_stream_of_targets(bench):
    body = f"""
      q = {joints(0, 0, 0, 0, 0, 0)}
      i = 0
      while i < 500:
        q[0] = q[0] + 0.0004
        servoj(q, t=0.002, lookahead_time=0.05, gain=300)
        i = i + 1
      end
      i = 0
      while i < 300:
        servoj(q, t=0.002)
        i = i + 1
      end
    """
    begun = bench(errors={})
    begun.run(body)
    assert begun.motion.target[0] == pytest.approx(HOME[0] + 0.2, abs=1e-6)


def test_the_slider_makes_a_move_longer(bench):
    begun = bench(errors={})
    begun.motion.slider = 0.5
    seen = watched(begun, f"movej({joints(0.5, 0, 0, 0, 0, 0)}, a=5, v=0.5)")
    assert max(speed[0] for _, _, speed, _, _ in seen) == pytest.approx(0.25, rel=1e-3)


def test_the_arm_lags_by_the_setting_and_is_at_its_goal_in_the_end(bench):
    seen = watched(bench(errors={"servo": 1.0}, lag_ms=4.0), f"movej({joints(0.8, 0, 0, 0, 0, 0)}, a=5, v=1)")
    cruising = [(target[0], actual[0]) for _, target, speed, actual, _ in seen if abs(speed[0] - 1.0) < 1e-6]
    target, actual = cruising[len(cruising) // 2]
    assert target - actual == pytest.approx(0.004, rel=0.01)
    assert seen[-1][3] == pytest.approx(seen[-1][1])


def test_a_pause_brakes_along_the_path_and_a_play_goes_on(bench):
    begun = bench(errors={})
    begun.run(f"movej({joints(0.5, -0.5, 0, 0, 0, 0)}, a=1, v=0.5)", seconds=0.6)
    assert begun.controller.runtime.pause()
    begun.let_pass(0.5)
    assert begun.controller.runtime.state is RuntimeState.PAUSED
    stands = begun.motion.target
    change = np.array(stands) - HOME
    assert change[1] == pytest.approx(-change[0])
    begun.let_pass(0.5)
    assert begun.motion.target == stands
    assert begun.controller.runtime.play()
    begun.until(lambda: not begun.controller.runtime.active)
    assert begun.motion.target[0] == pytest.approx(0.5)


def test_two_threads_cannot_move_the_arm(bench):
    body = f"""
      thread other():
        movej({joints(0.1, 0, 0, 0, 0, 0)})
      end
      t = run other()
      movej({joints(0.2, 0, 0, 0, 0, 0)})
    """
    assert bench().run(body)[-1].endswith("Another thread is already controlling the robot")


def test_a_joint_limit_is_a_protective_stop(bench):
    begun = bench(errors={})
    begun.run("speedj([0, 0, 0, 0, 0, 3], 20, t=9)", seconds=4.0)
    assert begun.controller.safety is SafetyMode.PROTECTIVE_STOP
    assert degrees(begun.motion.actual()[5]) == pytest.approx(360.0, abs=30.0)
    assert begun.motion.steady()


def test_a_target_faster_than_a_joint_is_a_protective_stop(bench):
    begun = bench(errors={})
    begun.run("speedj([5, 0, 0, 0, 0, 0], 40, t=1)", seconds=1.0)
    assert begun.controller.safety is SafetyMode.PROTECTIVE_STOP


def test_a_tip_that_is_pushed_deep_into_a_sphere_is_a_protective_stop_and_the_probe_has_seen_it(bench):
    begun = bench(errors={})
    x, y, z = begun.scene.tcp()
    sphere = replace(CELL.artefact.spheres[0], centre=(x, y, z - 80.0))
    cell = replace(CELL, artefact=replace(CELL.artefact, spheres=(sphere,)))
    other = bench(errors={}, cell=cell)
    closed = []
    other.scene.contact.subscribe(closed.append)
    other.run("speedl([0, 0, -0.05, 0, 0, 0], 1, t=5)", seconds=4.0)
    assert closed[0] is True
    assert other.controller.safety is SafetyMode.PROTECTIVE_STOP
    assert 3.0 < 30.6 - dist(other.scene.tcp(), sphere.centre) < 8.0


def test_a_search_stops_at_the_probe_s_input(bench):
    begun = bench(errors={})
    x, y, z = begun.scene.tcp()
    sphere = replace(CELL.artefact.spheres[0], centre=(x, y, z - 60.0))
    cell = replace(CELL, artefact=replace(CELL.artefact, spheres=(sphere,)))
    other = bench(errors={}, cell=cell)
    body = "while not get_digital_in(0):\n speedl([0, 0, -0.01, 0, 0, 0], 0.5, t=0.002)\nend\nstopl(0.5)"
    assert other.run(body) == []
    other.settle()
    overtravel = 30.6 - dist(other.scene.tcp(), sphere.centre)
    # by one cycle, and the braking way v²/2a
    assert 0.0 < overtravel < 0.01 * 2 * 0.002 * 1e3 + 0.01**2 / (2 * 0.5) * 1e3 + 0.05


def test_each_visit_to_a_pose_has_its_own_scatter(bench):
    begun = bench(errors={"repeatability": 1.0})
    places = []
    for _ in range(3):
        begun.run(f"movej({joints(0.1, 0, 0, 0, 0, 0)})\nsleep(0.2)")
        places.append(begun.scene.tcp())
        begun.run(f"movej({joints(0, 0, 0, 0, 0, 0)})\nsleep(0.2)")
    apart = [dist(a, b) for a, b in pairwise(places)]
    assert all(1e-4 < one < 0.3 for one in apart)
    assert begun.scene.arm.attempt == 3  # at home, where it began


def test_currents_hold_the_arm_and_are_zero_without_power(bench):
    begun = bench()
    holding = begun.controller.currents(noise=False)
    assert holding == begun.scene.motor_currents()
    assert max(map(abs, holding)) > 0.5
    begun.let_pass(60.0)
    assert begun.controller.currents(noise=False) == holding
    begun.command("power off")
    assert set(begun.controller.currents()) == {0.0}


def test_moves_speeds_and_programs_are_events(bench):
    begun = bench(errors={})
    begun.run(f"movej({joints(0.01, 0, 0, 0, 0, 0)})\nspeedj([0.1, 0, 0, 0, 0, 0], 1, t=0.01)\nstopj(1)")
    assert [begun.faults.counts[name] for name in ("robot.move", "ur.speed", "ur.program")] == [1, 1, 1]
