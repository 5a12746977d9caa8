"""What the instrument measures: places to their true values, faces, compensator, air, constant, noise, time."""

from math import cos, hypot, pi, radians, sin

import numpy as np
import pytest

from sims.geocom import _optics
from sims.geocom._accuracy import ARCSEC, PROFILES
from tests.helpers.station import Air, Arm, Reflector, Scene, World

PLACE = (1200.0, 2400.0, -300.0)
HZ, V = np.arctan2(PLACE[0], PLACE[1]), np.arctan2(hypot(*PLACE[:2]), PLACE[2])
LENGTH = float(np.linalg.norm(PLACE))
STANDARD = Air()
"""12 °C, 1013.25 hPa, 60 %: what the instrument is set to when it is switched on, but for 0.1 ppm."""


def place_of(hz, v, metres):
    return np.array([sin(v) * sin(hz), sin(v) * cos(hz), cos(v)]) * metres * 1e3


@pytest.fixture
def one(bench):
    """A bench with one reflector, and the instrument aimed at it."""

    def make(scene=None, **build):
        line = bench(Reflector("R1", PLACE), scene=scene, **build)
        assert line.aim(HZ + 0.002, V - 0.002) == (0, [])
        return line

    return make


def test_a_perfect_instrument_measures_the_true_place(one):
    code, (hz, v, metres) = one().measure()
    assert code == 0
    assert place_of(hz, v, metres) == pytest.approx(PLACE, abs=1e-3)


def test_the_place_is_in_the_instruments_own_frame_wherever_it_stands(bench):
    angle = radians(130.0)
    frame = np.eye(4)
    frame[:3, :3] = [[cos(angle), -sin(angle), 0.0], [sin(angle), cos(angle), 0.0], [0.0, 0.0, 1.0]]
    frame[:3, 3] = [2500.0, -600.0, 900.0]
    base = (frame @ [*PLACE, 1.0])[:3]
    reflector = Reflector("R1", tuple(base), tuple(frame[:3, 3] - base))
    line = bench(scene=Scene([reflector], frame=frame))
    assert line.aim(HZ, V) == (0, [])
    _, (hz, v, metres) = line.measure()
    assert place_of(hz, v, metres) == pytest.approx(PLACE, abs=1e-3)


def test_the_other_ways_to_ask_give_the_same_place(one):
    line = one()
    line.measure()
    _, (hz, v, metres) = line.ask(2108, 0, 1)
    assert line.ask(2107, 1) == (0, pytest.approx([hz, v]))
    assert line.ask(2117) == (0, pytest.approx([hz, v, metres]))
    assert line.ask(17017, 2) == (0, pytest.approx([hz, v, metres, 2]))
    _, east_north_up = line.ask(2116, 0, 1)
    assert np.multiply(east_north_up, 1e3) == pytest.approx(PLACE, abs=1e-3)
    code, coordinate = line.ask(2082, 0, 1)
    assert code == 0
    assert coordinate[:3] == coordinate[4:7] == pytest.approx(east_north_up)
    code, full = line.ask(2167, 0, 1)
    assert code == 0
    assert [*full[:2], full[6]] == pytest.approx([hz, v, metres])
    assert full[2] == pytest.approx(0.5 * ARCSEC)
    code, angle = line.ask(2003, 1)
    assert (angle[0], angle[1], angle[8]) == pytest.approx((hz, v, 0))


def test_station_and_orientation_shift_and_turn_the_coordinates(one):
    line = one()
    line.measure()
    line.set(2010, 10.0, 20.0, 30.0, 0.5)
    _, (east, north, height) = line.ask(2116, 0, 1)
    assert (east - 10, north - 20, height - 30.5) == pytest.approx(np.divide(PLACE, 1e3), abs=1e-6)
    line.set(2113, 0.25)
    _, (hz, _) = line.ask(2107, 1)
    assert hz == pytest.approx(0.25)


def test_collimation_and_index_errors_are_in_one_face_and_not_in_the_mean_of_two(one):
    line = one(collimation_arcsec=20.0, index_arcsec=-30.0)
    _, (hz_1, v_1, metres_1) = line.measure()
    line.set(9028, 0, 1, 0)
    assert line.ask(2003, 1)[1][8] == 1
    _, (hz_2, v_2, metres_2) = line.measure()
    assert metres_2 == pytest.approx(metres_1)
    assert hz_1 - HZ == pytest.approx(20 * ARCSEC / sin(V), abs=1e-9)
    assert v_1 - V == pytest.approx(-30 * ARCSEC, abs=1e-9)
    assert ((hz_1 + hz_2 - pi) / 2, (v_1 + 2 * pi - v_2) / 2) == pytest.approx((HZ, V), abs=1e-9)


@pytest.mark.parametrize("arcmin", [0.0, 3.0])
def test_within_its_range_the_compensator_refers_the_place_to_gravity(one, arcmin):
    lean = radians(arcmin / 60)
    line = one(Scene([Reflector("R1", PLACE)], world=World((sin(lean), 0.0, cos(lean)))))
    code, (hz, v, metres) = line.measure()
    assert code == 0
    level = np.array([[cos(lean), 0.0, -sin(lean)], [0.0, 1.0, 0.0], [sin(lean), 0.0, cos(lean)]]) @ PLACE
    assert place_of(hz, v, metres) == pytest.approx(level, abs=1e-3)
    line.set(2006, 0)
    assert line.aim(HZ, V) == (0, [])
    _, (hz, v, metres) = line.measure()
    assert place_of(hz, v, metres) == pytest.approx(PLACE, abs=1e-3)


def test_beyond_the_compensators_range_warnings_carry_uncorrected_data_and_far_beyond_nothing_does(one):
    line = one()
    line.fault(fault="tracker.tilt", arcmin=6, for_ms=20_000)
    code, (hz, v, metres) = line.measure()
    assert code == 1283
    assert place_of(hz, v, metres) == pytest.approx(PLACE, abs=1e-3)
    code, angles = line.ask(2107, 1)
    assert (code, angles) == (1288, pytest.approx([hz, v]))
    _, full = line.ask(2167, 0, 1)
    assert max(map(abs, full[3:5])) == pytest.approx(radians(4 / 60))  # as far as the sensor can see
    line.fault(fault="tracker.tilt", arcmin=90, for_ms=20_000)
    assert line.measure() == (22, [])
    assert line.ask(2107, 1) == (22, [])
    line.set(2006, 0)  # without the compensator nothing is promised, and nothing refused
    assert line.measure()[0] == 0


def test_the_inclination_is_reported_across_and_along_the_line_of_sight(one):
    lean = radians(2 / 60)
    line = one(Scene([Reflector("R1", PLACE)], world=World((-sin(lean) * sin(HZ), -sin(lean) * cos(HZ), cos(lean)))))
    line.measure()
    _, full = line.ask(2167, 0, 1)
    assert full[3:5] == pytest.approx([0.0, lean], abs=1e-6)  # it leans towards the reflector
    assert full[5] == pytest.approx(radians(1 / 3600), rel=1e-6)


def test_the_air_that_is_set_corrects_the_distance_and_the_true_air_does_not_follow(one):
    true = Air(28.0, 990.0, 40.0)
    line = one(Scene([Reflector("R1", PLACE)], air=true))
    needed = _optics.ppm_of_air(28.0, 990.0, _optics.vapour_of_humidity(28.0, 40.0))
    _, (*_, metres) = line.measure()
    assert metres * 1e3 == pytest.approx(LENGTH * (1 - needed * 1e-6), abs=1e-6)
    assert LENGTH - metres * 1e3 > 0.04
    wet = 18.6  # by Sprung's formula, 40 % at 28 °C
    line.set(2028, 0.658, 990.0, 28.0, wet)
    _, (*_, metres) = line.measure()
    assert metres * 1e3 == pytest.approx(LENGTH, abs=1e-3)


def test_a_constant_that_is_set_wrong_shifts_every_distance_alike(bench):
    near, far = Reflector("N1", (0.0, 2000.0, 0.0), constant_mm=-3.8), Reflector("N2", (0.0, 0.0, 9000.0))
    far = Reflector("N2", (9000.0, 0.0, 0.0), constant_mm=-3.8)
    line = bench(near, far)
    found = []
    for set_m in (-0.0038, 0.0):
        line.set(17008, 9)
        line.set(2024, set_m)
        for hz in (0.0, pi / 2):
            assert line.aim(hz, pi / 2) == (0, [])
            found.append(line.measure()[1][2] * 1e3)
    assert found == pytest.approx([2000.0, 9000.0, 2003.8, 9003.8], abs=2e-3)


def test_another_prism_chosen_at_the_instrument_shows_in_the_distance(one):
    line = one()
    line.fault(fault="tracker.wrong_prism")
    assert line.measure()[1][2] * 1e3 == pytest.approx(LENGTH + 17.5, abs=1e-3)
    assert line.ask(17009) == (0, [1])


@pytest.mark.parametrize(("program", "seconds"), [(1, 0.5), (0, 1.0), (11, 2.0), (7, 3.0)])
def test_a_distance_takes_as_long_as_its_program(one, program, seconds):
    line = one()
    line.set(17019, program)
    line.set(2008, 1, 1)
    taken, (code, _) = line.timed(2108, 20_000, 1)
    assert code == 0
    assert taken == pytest.approx(seconds, abs=0.03)


def test_who_does_not_wait_long_enough_gets_angles_only(one):
    line = one()
    line.set(2008, 1, 1)
    taken, (code, values) = line.timed(2108, 300, 1)
    assert (code, values[2]) == (1285, 0.0)
    assert taken == pytest.approx(0.3, abs=0.02)
    assert line.ask(2108, 20_000, 1)[0] == 0
    line.set(2008, 3, 1)
    assert line.ask(2108, 20_000, 1)[0] == 1285  # cleared: there is nothing to wait for


def test_a_distance_stays_until_it_is_cleared_or_the_telescope_turns(one):
    line = one(noise_scale=1.0)
    first = line.measure()[1][2]
    assert line.ask(2108, 0, 1)[1][2] == first
    line.set(9027, HZ, V, 0, 0, 0)
    assert line.ask(2108, 0, 1)[0] == 1285


@pytest.mark.parametrize(
    ("command", "code", "then"),
    [
        (0, 0, 1285),
        (1, 0, 0),
        (2, 0, 0),
        (3, 0, 1285),
        (4, 0, 1285),
        (6, 0, 0),
        (8, 0, 0),
        (10, 27, 1285),
        (11, 0, 1285),
    ],
)
def test_each_command_begins_a_distance_or_none(one, command, code, then):
    line = one()
    assert line.ask(2008, command, 1) == (code, [])
    assert line.ask(2108, 20_000, 1)[0] == then


@pytest.mark.parametrize(("mode", "then"), [(0, 0), (1, 0), (5, 1285), (6, 1285)])
def test_a_reading_without_distance_keeps_or_clears_the_last_one(one, mode, then):
    line = one()
    line.measure()
    assert line.ask(17017, mode)[1][2:] == [0.0, mode]
    assert line.ask(2108, 0, 1)[0] == then


def test_without_a_reflector_in_the_beam_there_is_an_error_and_no_data(bench):
    line = bench(Reflector("R1", PLACE))
    line.set(9027, HZ + 0.01, V, 0, 0, 0)
    assert line.measure() == (1292, [])
    assert line.ask(17017, 2) == (1292, [])
    assert line.ask(17017, 1)[0] == 0  # angles need none


@pytest.mark.parametrize(("length", "code"), [(1000.0, 829), (300_000.0, 818), (1600.0, 0)])
def test_too_near_and_too_far_have_their_codes(bench, length, code):
    line = bench(Reflector("R1", (0.0, length, 0.0)))
    assert line.aim(0.0, pi / 2) == (0, [])
    assert line.measure()[0] == code


def test_a_reflector_that_moves_during_a_measurement_makes_it_unstable(one):
    line = one()
    line.set(2008, 1, 1)
    line.scene.targets[0] = Reflector("R1", (PLACE[0], PLACE[1] + 2.0, PLACE[2]))
    assert line.ask(2108, 20_000, 1) == (776, [])


def test_a_reflector_turned_almost_away_is_measured_with_a_warning(bench):
    turned = radians(28.5)
    line = bench(Reflector("R1", (0.0, 3000.0, 0.0), (sin(turned), -cos(turned), 0.0)))
    assert line.aim(0.0, pi / 2) == (0, [])
    code, values = line.measure()
    assert (code, len(values)) == (1284, 3)


def test_without_reflector_it_does_not_measure(one):
    line = one()
    assert line.ask(2008, 10, 1) == (27, [])
    line.set(17021, 1)
    assert line.ask(2008, 1, 1) == (27, [])


def test_tracking_gives_a_new_distance_each_time(one):
    line = one()
    line.set(2008, 2, 1)
    assert line.ask(2108, 1000, 1)[0] == 0
    line.scene.targets[0] = Reflector("R1", tuple(1.01 * part for part in PLACE))
    assert line.ask(2108, 1000, 1)[1][2] * 1e3 == pytest.approx(1.01 * LENGTH, abs=1e-3)


@pytest.mark.parametrize("name", PROFILES)
def test_samples_scatter_by_the_profile(one, name):
    profile = PROFILES[name]
    line = one(noise_scale=1.0, profile=profile)
    samples = np.array([line.measure()[1] for _ in range(150)])
    across, along = profile.sample.angle_rad(LENGTH), profile.sample.along_mm(LENGTH)
    found = samples.std(axis=0) * [sin(V), 1.0, 1e3]
    assert found == pytest.approx([across, across, along], rel=0.25)


def test_what_samples_have_in_common_is_another_at_another_pose_of_the_robot(one):
    line = one(noise_scale=1.0)
    offsets = []
    for attempt in range(40):
        line.scene.arm = Arm(attempt=attempt)
        offsets.append(np.mean([line.ask(2107, 1)[1] for _ in range(20)], axis=0) - [HZ, V])
    sigma = 0.05 / LENGTH + 0.2 * ARCSEC  # and 0.5″ / √20 of the samples, which is little
    assert np.std(offsets, axis=0) * [sin(V), 1.0] == pytest.approx([sigma, sigma], rel=0.4)


def test_what_readings_of_a_reflector_have_in_common_is_the_same_place_in_both_faces(one):
    line = one(noise_scale=1.0)
    first = np.mean([line.ask(2107, 1)[1] for _ in range(200)], axis=0)
    line.set(9028, 0, 1, 0)
    second = np.mean([line.ask(2107, 1)[1] for _ in range(200)], axis=0)
    assert abs(first[1] - V) > 5e-6  # the common part is there
    assert (first[1], first[0]) == pytest.approx((2 * pi - second[1], second[0] - pi), abs=5 * 0.5 * ARCSEC / 14)


def test_all_distances_of_one_set_up_share_its_zero(one):
    zeros = []
    for seed in range(30):
        line = one(noise_scale=1.0, seed=seed)
        zeros.append(np.mean([line.measure()[1][2] * 1e3 - LENGTH for _ in range(10)]))
    expected = np.hypot(0.16, 0.12 / np.sqrt(10))
    assert np.std(zeros) == pytest.approx(expected, rel=0.4)


@pytest.mark.parametrize(
    ("name", "across_um", "along_um"),
    [("at960", (15 + 6 * 3) / 2, (15 + 0.5 * 3) / 2), ("vantage", (20 + 5 * 3) / 2, (16 + 0.8 * 3) / 2)],
)
def test_sample_and_common_part_make_half_of_the_makers_permissible_error(name, across_um, along_um):
    parts = PROFILES[name].sample, PROFILES[name].common
    assert hypot(*(part.angle_rad(3000.0) * 3e6 for part in parts)) == pytest.approx(across_um)
    assert hypot(*(part.along_mm(3000.0) * 1e3 for part in parts)) == pytest.approx(along_um)


def test_noise_goes_by_what_is_measured_and_not_by_time(one):
    first, later = one(noise_scale=1.0), one(noise_scale=1.0)
    later.wait(3_600_000_000_000)
    assert [first.measure() for _ in range(3)] == [later.measure() for _ in range(3)]
    other = one(noise_scale=1.0, seed=2)
    assert other.measure() != first.measure()


def test_a_later_process_goes_on_with_the_next_reading(one):
    line = one(noise_scale=1.0)
    line.measure()
    kept = line.instrument.noise.state()
    second = line.measure()
    resumed = one(noise_scale=1.0)
    resumed.instrument.noise.recall(kept)
    assert resumed.measure() == second


def test_the_instruments_clock_runs_with_the_cells(one):
    line = one()
    line.measure()
    _, before = line.ask(2167, 0, 1)
    line.wait(1000 * 1_000_000_000)
    line.measure()
    _, after = line.ask(2167, 0, 1)
    assert after[7] - before[7] == pytest.approx(1_000_000, abs=2_000)
