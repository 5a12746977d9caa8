"""What an instrument measures: reflectors on the moving robot and in nests, its own place, temperatures."""

from dataclasses import replace
from math import atan2, degrees, dist

import numpy as np
import pytest

from sims.bench import catalogue
from sims.cell import Distance, FlangeReflector, Nest, Reflectors, Station
from sims.faults import Faults
from sims.kernel import Kernel
from sims.memory import Memory
from sims.robot_file import Frame
from sims.scene.scene import Scene
from tests.helpers.sims import read_fault, with_errors

STATION = Station(
    frame=Frame((2500.0, -1500.0, 300.0), (150.0, 0.0, 0.0)),
    nests=(
        Nest("N1", (1800.0, 900.0, 100.0)),
        Nest("N2", (-500.0, -1500.0, 200.0)),
        Nest("N3", (300.0, 1500.0, 1200.0)),
    ),
    distances=(Distance(("N1", "N2"), 3325.0, 0.01),),
)
REFLECTORS = Reflectors(
    constant_mm=-3.2,
    acceptance_deg=30.0,
    on_flange=(
        FlangeReflector("R1", (0.0, 0.0, 90.0), (0.0, 0.0, 2.0)),
        FlangeReflector("R2", (80.0, 0.0, 90.0), (1.0, 0.0, 1.0)),
    ),
)
HOUR_NS = 3_600_000_000_000
TARGET = (10.0, -90.0, 90.0, 0.0, 45.0, 0.0)


@pytest.fixture
def scene_of():
    """Makes scenes of the shipped robot with an instrument; without errors but for the given ones."""
    kernels = []

    def make(seed=1, at=STATION, down=(0.0, 0.0, -1.0), memory=None, **errors):
        base = with_errors(**errors)
        robot, simulate = replace(base.robot, down=down), replace(base.simulate, seed=seed)
        cell = replace(base, robot=robot, simulate=simulate, station=at, reflectors=REFLECTORS)
        kernel = Kernel("lockstep")
        kernels.append(kernel)
        return Scene(kernel, cell, Faults(kernel, catalogue()), memory=memory)

    yield make
    for kernel in kernels:
        kernel.close()


def start(scene, **fault):
    """The fault starts at once."""
    scene._faults._start(read_fault(fault))


def frame(scene, readings):
    """The flange of the perfect robot by its own kinematics: the tool's pose with the taught tool taken off."""
    tool = scene.world._tool_pose
    x, y, z, a, b, c = scene.world.shown_pose(readings)
    from sims.world.kinematics import pose

    return pose((x, y, z), (a, b, c)) @ np.linalg.inv(tool)


def test_without_errors_reflectors_are_on_the_flange_as_the_file_says(scene_of):
    scene = scene_of()
    flange = frame(scene, scene.arm.joints())
    one, two, *_ = scene.reflectors()
    assert one.xyz == pytest.approx((flange @ [0.0, 0.0, 90.0, 1.0])[:3], abs=1e-9)
    assert two.xyz == pytest.approx((flange @ [80.0, 0.0, 90.0, 1.0])[:3], abs=1e-9)
    assert one.facing == pytest.approx(flange[:3, 2], abs=1e-12)
    assert two.facing == pytest.approx((flange[:3, 0] + flange[:3, 2]) / np.sqrt(2.0), abs=1e-12)
    assert (one.id, one.acceptance_deg, one.constant_mm) == ("R1", 30.0, -3.2)


def test_reflectors_move_with_the_arm_and_nests_do_not(scene_of):
    scene = scene_of()
    before = scene.reflectors()
    scene.arm.move(TARGET, 10.0, lambda: None)
    end = scene.arm._motion.end_ns
    half, after = scene.reflectors(end // 2), scene.reflectors(end)
    assert 10.0 < dist(half[0].xyz, before[0].xyz) < dist(after[0].xyz, before[0].xyz)
    assert after[0].xyz == pytest.approx((frame(scene, TARGET) @ [0.0, 0.0, 90.0, 1.0])[:3], abs=1e-6)
    assert [one.xyz for one in after[2:]] == [one.xyz for one in before[2:]]


def test_reflectors_share_the_robots_errors_but_not_the_bending_of_its_tool(scene_of):
    perfect, bent, soft = scene_of(), scene_of(deflection=1.0), scene_of(compliance=1.0)
    assert bent.reflectors()[0].xyz == pytest.approx(perfect.reflectors()[0].xyz, abs=1e-9)
    assert dist(soft.reflectors()[0].xyz, perfect.reflectors()[0].xyz) > 0.1


def test_the_robots_reflectors_are_off_their_places_by_half_a_millimetre_on_each_axis(scene_of):
    perfect = scene_of().reflectors()
    offsets = np.array(
        [
            np.subtract(scene_of(seed, reflector=1.0).reflectors()[i].xyz, perfect[i].xyz)
            for seed in range(60)
            for i in (0, 1)
        ]
    )
    assert offsets.std() == pytest.approx(0.5, rel=0.15)
    assert abs(offsets.mean()) < 0.1
    twice = scene_of(3, reflector=2.0).reflectors()[0].xyz
    once = scene_of(3, reflector=1.0).reflectors()[0].xyz
    assert np.subtract(twice, perfect[0].xyz) == pytest.approx(2.0 * np.subtract(once, perfect[0].xyz), abs=1e-9)


def test_nests_face_the_station_and_keep_their_certified_distance(scene_of):
    scene = scene_of(5, station=1.0)
    nests = {one.id: one for one in scene.reflectors()[2:]}
    assert list(nests) == ["N1", "N2", "N3"]
    assert dist(nests["N1"].xyz, nests["N2"].xyz) == pytest.approx(3325.0, abs=0.05)
    off = dist(nests["N3"].xyz, STATION.nests[2].xyz)
    assert 0.1 < off < 8.0
    way = scene.station()[:3, 3] - nests["N3"].xyz
    assert nests["N3"].facing == pytest.approx(way / np.linalg.norm(way))


def test_a_levelled_station_is_within_arc_minutes_of_the_vertical_and_near_its_rough_frame(scene_of):
    for seed in range(20):
        scene = scene_of(seed, station=1.0)
        station = scene.station()
        assert 0.005 <= scene.tilt <= 0.03
        assert np.linalg.norm(station[:3, 3] - STATION.frame.xyz) == pytest.approx(10.0)
        heading = degrees(atan2(station[1, 0], station[0, 0])) - 150.0
        assert abs(heading) < 1.0
        assert station[:3, :3] @ station[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)


def test_the_vertical_is_that_of_gravity_and_not_of_the_robots_base(scene_of):
    down = (np.sin(np.radians(1.0)), 0.0, -np.cos(np.radians(1.0)))
    level = scene_of(down=down)
    assert level.tilt == pytest.approx(0.0, abs=1e-5)
    assert level.station()[:3, 2] == pytest.approx([-down[0], 0.0, -down[2]])


def test_an_instrument_on_its_side_is_not_levelled(scene_of):
    aside = scene_of(at=replace(STATION, frame=Frame((2500.0, 0.0, 300.0), (0.0, 90.0, 0.0))))
    assert aside.tilt == pytest.approx(90.0)


def test_the_station_drifts_by_its_scale_and_the_robot_does_not(scene_of):
    still, drifting = scene_of(), scene_of(station_drift=2.0)
    assert still.station(5 * HOUR_NS) == pytest.approx(still.station(0))
    moved = drifting.station(5 * HOUR_NS)[:3, 3] - drifting.station(0)[:3, 3]
    assert np.linalg.norm(moved) == pytest.approx(2.0 * 5 * 0.03)
    turned = drifting.station(5 * HOUR_NS)[:3, :3] @ drifting.station(0)[:3, :3].T
    assert degrees(np.arccos((np.trace(turned) - 1.0) / 2.0)) == pytest.approx(2.0 * 5 * 0.0003, rel=1e-3)
    assert drifting.reflectors(5 * HOUR_NS)[0] == still.reflectors(0)[0]


def test_a_bumped_station_stays_where_it_was_bumped_to_also_for_the_next_process(scene_of, tmp_path):
    scene = scene_of(memory=Memory(tmp_path / "memory.json"))
    before = scene.station()
    start(scene, fault="station.bump", mm=0.7, deg=0.05)
    after = scene.station()
    assert np.linalg.norm(after[:3, 3] - before[:3, 3]) == pytest.approx(0.7)
    assert np.degrees(np.arccos((np.trace(after[:3, :3] @ before[:3, :3].T) - 1) / 2)) == pytest.approx(0.05, rel=1e-4)
    start(scene, fault="station.bump", mm=0.7, deg=0.0)
    assert not np.allclose(scene.station(), after)
    again = scene_of(memory=Memory(tmp_path / "memory.json"))
    assert again.station() == pytest.approx(scene.station(), abs=1e-12)


def test_a_wrong_reflector_has_another_constant_everywhere(scene_of):
    scene = scene_of()
    start(scene, fault="reflector.wrong", mm=7.5)
    assert [one.constant_mm for one in scene.reflectors()] == pytest.approx([-3.2 + 7.5] * 5)


def test_a_cell_without_station_says_so(scene_of):
    with pytest.raises(LookupError, match="station:"):
        scene_of(at=None).station()


def test_with_all_off_it_is_twenty_degrees_always(scene_of):
    environment = scene_of().environment(5 * HOUR_NS)
    assert (environment.air_c, environment.arm_c, environment.base_c, environment.fixture_c) == (20.0,) * 4
    assert (environment.pressure_hpa, environment.humidity_percent) == (1013.25, 45.0)


def test_the_arm_warms_up_and_its_links_grow_by_that_temperature(scene_of):
    warm, cold = scene_of(warm_up=1.0), scene_of()
    rise = warm.environment(10 * HOUR_NS).arm_c - 20.0
    assert rise == pytest.approx(2.6, abs=0.1)
    assert warm.environment(10 * HOUR_NS).air_c == 20.0
    assert warm.environment(1_200_000_000_000).arm_c - 20.0 == pytest.approx(rise * (1.0 - np.exp(-1.0)), rel=1e-3)
    flange = np.array(cold.arm.flange(0)[:3, 3])
    grown = np.subtract(warm.reflectors(10 * HOUR_NS)[0].xyz, cold.reflectors(10 * HOUR_NS)[0].xyz)
    assert grown == pytest.approx(rise * 1.75e-5 * flange, abs=1e-6)


def test_with_expansion_each_link_follows_the_arms_temperature(scene_of):
    scene = scene_of(expansion=1.0, warm_up=1.0, air=1.0)
    from sims.conditions import Conditions

    for hours in (0, 3, 9, 20):
        arm_c = scene.environment(hours * HOUR_NS).arm_c
        scene.world.warm(hours * HOUR_NS)
        expected = scene.world.true_tcp(scene.arm.joints(), Conditions(temperature_c=arm_c))
        assert scene.tcp() == pytest.approx(expected, abs=2e-4)


def test_the_air_swings_over_a_day_and_castings_follow_it_later_and_less(scene_of):
    scene = scene_of(2, air=1.0)
    day = [scene.environment(minute * 60_000_000_000) for minute in range(0, 1440, 10)]
    air, arm = (np.array([getattr(one, name) for one in day]) for name in ("air_c", "arm_c"))
    assert air.max() == pytest.approx(21.5, abs=0.01)
    assert air.min() == pytest.approx(18.5, abs=0.01)
    assert arm.max() < air.max() - 0.1
    assert (int(arm.argmax()) - int(air.argmax())) % len(day) in range(6, 15)  # one to two and a half hours
    assert day[-1].humidity_percent == pytest.approx(45.0 - 2.0 * (day[-1].air_c - 20.0))
