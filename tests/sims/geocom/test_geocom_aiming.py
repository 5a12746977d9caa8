"""Finding and following a reflector: positioning, search windows, lock, broken beams, change of face."""

from math import cos, pi, radians, sin

import pytest

from tests.helpers.station import Reflector

S = 1_000_000_000
LEVEL = pi / 2


def at(hz_deg, length=3000.0, v_deg=90.0, **others):
    hz, v = radians(hz_deg), radians(v_deg)
    return Reflector(
        others.pop("id", f"R{hz_deg}"),
        (length * sin(v) * sin(hz), length * sin(v) * cos(hz), length * cos(v)),
        **others,
    )


def locked(line):
    line.set(18007, 1)
    assert line.aim(0.0, LEVEL) == (0, [])
    assert line.ask(9013) == (0, [])
    assert line.ask(6021) == (0, [1])
    return line


def events(line):
    return dict(line.faults.counts)


def test_turning_takes_the_longer_of_both_angles_at_the_motors_speed(bench):
    line = bench(speed_deg_s=30.0)
    taken, _ = line.timed(9027, radians(90), radians(60), 0, 0, 0)
    assert taken == pytest.approx(90 / 30 + 0.3, abs=0.02)
    assert line.ask(2107, 1)[1] == pytest.approx([radians(90), radians(60)])
    taken, _ = line.timed(9027, radians(-10), radians(60), 0, 0, 0)  # the shortest way is across zero
    assert taken == pytest.approx(100 / 30 + 0.3, abs=0.02)


def test_a_turn_beyond_its_time_out_stops_on_the_way(bench):
    line = bench(speed_deg_s=10.0)
    line.set(9011, 2.0, 2.0)
    assert line.ask(9027, radians(90), LEVEL, 0, 0, 0) == (8704, [])
    assert line.ask(2107, 1)[1][0] == pytest.approx(radians(20), abs=1e-6)


def test_a_fine_adjustment_points_at_the_reflector(bench):
    line = bench(at(0.3, v_deg=90.2))
    line.set(18005, 1)
    taken, answer = line.timed(9037, 0.02, 0.02, 0)
    assert answer == (0, [])
    assert taken == pytest.approx(2.0, abs=0.02)
    assert line.ask(2107, 1)[1] == pytest.approx([radians(0.3), radians(90.2)])


def test_it_needs_target_recognition(bench):
    line = bench(at(0))
    assert line.ask(9037, 0.01, 0.01, 0) == (8714, [])
    assert line.ask(9027, 0.0, LEVEL, 0, 1, 0) == (8714, [])
    line.set(9018, 1)
    assert line.ask(9037, 0.01, 0.01, 0) == (0, [])


@pytest.mark.parametrize(
    ("target", "code"),
    [
        (at(1.5), 8710),  # outside the window of ± 1°
        (at(0.9), 0),
        (at(0, facing=(0.0, 1.0, 0.0)), 8710),  # turned away
        (at(0, facing=(sin(radians(29)), -cos(radians(29)), 0.0)), 0),
        (at(0, facing=(sin(radians(31)), -cos(radians(31)), 0.0)), 8710),  # beyond its acceptance of 30°
    ],
)
def test_only_a_reflector_in_the_window_that_faces_the_instrument_is_found(bench, target, code):
    assert bench(target).aim(0.0, LEVEL, radians(1.0)) == (code, [])


def test_a_hidden_reflector_is_not_found_and_the_telescope_turns_back(bench):
    line = bench(at(0.3, id="R1"))
    line.scene.hidden.add("R1")
    line.set(18005, 1)
    taken, answer = line.timed(9037, 0.02, 0.02, 0)
    assert answer == (8710, [])
    assert taken > 2.0
    assert line.ask(2107, 1)[1] == pytest.approx([0.0, LEVEL])


def test_two_reflectors_in_the_window_are_refused_and_a_smaller_window_tells_them_apart(bench):
    line = bench(at(0), at(1.0))
    assert line.aim(0.0, LEVEL, radians(1.5)) == (8711, [])
    assert line.aim(0.0, LEVEL, radians(0.8)) == (0, [])
    assert line.aim(radians(1.0), LEVEL, radians(0.8)) == (0, [])
    assert line.ask(2107, 1)[1][0] == pytest.approx(radians(1.0))


def test_a_second_reflection_beside_the_reflector_is_as_two(bench):
    line = bench(at(0))
    line.fault(fault="tracker.second_target", beside_mm=20, for_ms=30_000)
    assert line.aim(0.0, LEVEL, radians(0.6)) == (8711, [])
    line.wait(30 * S)
    assert line.aim(0.0, LEVEL, radians(0.6)) == (0, [])


def test_a_wide_search_takes_longer_and_gives_up_after_its_time(bench):
    line = bench(at(3.0))
    line.set(18005, 1)
    taken, answer = line.timed(9037, radians(7), radians(7), 0)
    assert answer == (0, [])
    assert taken == pytest.approx(2.0 + 6.0**2 / 20.0, abs=0.02)
    line = bench(at(9.0))
    line.set(18005, 1)
    taken, answer = line.timed(9037, radians(24), radians(24), 0)
    assert answer == (8704, [])
    assert taken == pytest.approx(2.0 + 5.0, abs=0.02)


@pytest.mark.parametrize(
    ("hz", "adjusted", "locked_in"), [(0.17, 0, 0), (0.18, 8710, 0), (0.69, 8710, 0), (0.71, 8710, 8725)]
)
def test_the_smallest_window_is_a_quarter_of_the_field_of_view_in_which_it_locks(bench, hz, adjusted, locked_in):
    line = bench(at(hz))
    line.set(18007, 1)
    assert line.ask(9037, 0.0, 0.0, 0) == (adjusted, [])
    line.set(9027, 0.0, LEVEL, 0, 0, 0)
    assert line.ask(9013) == (locked_in, [])


def test_positioning_can_adjust_and_lock_by_itself(bench):
    line = bench(at(0.5))
    line.set(18007, 1)
    assert line.ask(9027, 0.0, LEVEL, 0, 1, 0) == (0, [])
    assert line.ask(2107, 1)[1][0] == pytest.approx(radians(0.5))
    assert line.ask(6021) == (0, [1])


def test_a_lock_follows_the_reflector(bench):
    line = locked(bench(at(0)))
    line.scene.arm.moving = True
    for hz in (0.5, 1.0, 1.5):
        line.scene.targets[0] = at(hz, id="R0")
        line.wait(S // 2)
    line.scene.arm.moving = False
    assert line.ask(6021) == (0, [1])
    assert line.ask(2107, 1)[1][0] == pytest.approx(radians(1.5))
    line.set(9027, 0.1, LEVEL, 0, 0, 0)
    assert line.ask(6021) == (0, [0])  # positioned by hand: nothing is followed


def test_a_lock_needs_lock_mode_and_a_reflector_in_view(bench):
    line = bench(at(0), at(20.0))
    assert line.ask(9013) == (8714, [])
    line.set(9020, 1)
    line.set(9027, radians(10), LEVEL, 0, 0, 0)
    assert line.ask(9013) == (8725, [])
    assert line.ask(6021) == (0, [0])


def test_a_broken_beam_is_predicted_for_a_moment_and_regained(bench):
    line = locked(bench(at(0)))
    line.fault(fault="tracker.beam_broken", for_ms=800)
    line.wait(S // 2)
    assert line.ask(6021) == (0, [2])
    line.wait(S)
    assert line.ask(6021) == (0, [1])


def test_a_beam_broken_for_longer_is_lost_and_needs_a_new_search(bench):
    line = locked(bench(at(0)))
    line.fault(fault="tracker.beam_broken", for_ms=3000)
    line.wait(S)
    assert line.ask(6021) == (0, [2])
    assert line.measure() == (1292, [])
    line.wait(3 * S)
    assert line.ask(6021) == (0, [0])
    assert line.ask(9037, 0.01, 0.01, 0) == (0, [])


def test_the_arm_between_breaks_the_beam(bench):
    line = locked(bench(at(0, id="R1")))
    line.scene.arm.moving = True
    line.scene.hidden.add("R1")
    line.wait(S // 8)
    assert line.ask(6021) == (0, [2])
    line.scene.hidden.clear()
    line.wait(S // 8)
    assert line.ask(6021) == (0, [1])


@pytest.mark.parametrize(("hz", "state"), [(1.9, 1), (2.1, 0)])
def test_a_reflector_that_reappears_elsewhere_is_not_followed(bench, hz, state):
    line = locked(bench(at(0, id="R1")))
    line.scene.arm.moving = True
    line.scene.hidden.add("R1")
    line.wait(S // 8)  # it looks ten times a second
    line.scene.hidden.clear()
    line.scene.targets[0] = at(hz, id="R1")
    line.wait(2 * S)
    assert line.ask(6021) == (0, [state])


def test_a_reflector_that_moved_on_as_expected_is_followed_on(bench):
    line = locked(bench(at(0, id="R1")))
    line.scene.arm.moving = True
    for tenth in range(1, 11):  # 5 deg/s
        line.scene.targets[0] = at(0.5 * tenth, id="R1")
        line.wait(S // 10)
    line.scene.hidden.add("R1")
    line.wait(8 * S // 10)
    line.scene.hidden.clear()
    line.scene.targets[0] = at(9.0, id="R1")
    line.wait(S // 10)
    assert line.ask(6021) == (0, [1])


def test_a_reflector_lost_for_good_is_not_found_again_while_the_others_are(bench):
    line = locked(bench(at(0), at(20)))
    line.fault(fault="tracker.reflector_lost")
    line.wait(3 * S)
    assert line.ask(6021) == (0, [0])
    assert line.aim(0.0, LEVEL) == (8710, [])
    assert line.aim(radians(20), LEVEL) == (0, [])


def test_changing_the_face_turns_the_telescope_over_and_ends_the_lock(bench):
    line = locked(bench(at(0)))
    taken, answer = line.timed(9028, 0, 0, 0)
    assert answer == (0, [])
    assert taken == pytest.approx(180 / 45 + 0.3, abs=0.02)
    hz, v = line.ask(2107, 1)[1]
    assert (hz, v) == pytest.approx((pi, 3 * pi / 2))
    assert line.ask(6021) == (0, [0])
    assert line.ask(9028, 0, 1, 0) == (0, [])  # and back, with lock mode on
    assert line.ask(2107, 1)[1][1] == pytest.approx(LEVEL)
    assert line.ask(6021) == (0, [1])


def test_motors_driven_by_hand_need_their_controller(bench):
    line = bench()
    assert line.ask(6004, 0.1, 0.0) == (1792, [])
    line.set(6001, 1)
    line.set(6004, 0.1, 0.0)
    line.wait(2 * S)
    line.set(6002, 0)
    assert line.ask(2107, 1)[1][0] == pytest.approx(0.2, abs=0.01)


def test_the_fan_of_light_searches_the_working_area_and_about_the_axis(bench):
    line = bench(at(-40), at(30), at(100))
    assert line.ask(9052) == (8720, [])  # no working area yet
    line.set(9043, 0.0, LEVEL, radians(120), radians(20), 1)
    assert line.ask(9052) == (0, [])
    assert line.ask(2107, 1)[1][0] == pytest.approx(radians(320))
    for way, swing, hz in [(1, 0, 30), (1, 0, 100), (-1, 0, 30), (1, 1, 30), (1, 0, 100)]:
        assert line.ask(9051, way, swing) == (0, [])
        assert line.ask(2107, 1)[1][0] == pytest.approx(radians(hz))
    assert bench().ask(9051, 1, 1) == (8710, [])


@pytest.mark.parametrize(("swing", "degrees"), [(0, 30.0 - 0.7), (1, 30.0 + 9.0)])
def test_the_fan_of_light_sweeps_30_degrees_a_second_and_swings_back_by_10_gon(bench, swing, degrees):
    taken, answer = bench(at(30)).timed(9051, 1, swing)
    assert answer == (0, [])
    assert taken == pytest.approx(2.0 + degrees / 30.0, abs=0.02)


def test_sleep_ends_the_lock(bench):
    line = locked(bench(at(0)))
    line.set(112, 1)
    line.set(111, 1)
    assert line.ask(6021) == (0, [0])


def test_events_are_announced_for_the_fault_schedule(bench):
    line = locked(bench(at(0)))
    line.measure()
    assert events(line) == {"tracker.aim": 1, "tracker.lock": 1, "tracker.measure": 1}
