"""The true motor currents of the arm as devices read them: direction of approach, brakes, and after a restart."""

import pytest

from sims.bench import catalogue
from sims.faults import Faults
from sims.kernel import Kernel
from sims.memory import Memory
from sims.scene.scene import Scene
from tests.helpers.sims import with_errors

HOME = (0.0, -90.0, 90.0, 0.0, 45.0, 0.0)
S = 1_000_000_000


@pytest.fixture
def make():
    kernels = []

    def scene(memory=None):
        kernels.append(Kernel("lockstep"))
        return Scene(kernels[-1], with_errors(), Faults(kernels[-1], catalogue()), memory=memory), kernels[-1]

    yield scene
    for kernel in kernels:
        kernel.close()


def go(scene, kernel, target):
    scene.arm.move(target, 50.0, lambda: None)
    run_to(kernel, scene.arm._motion.end_ns + 1)


def run_to(kernel, time_ns):
    kernel.at(time_ns, kernel.stop)
    kernel.run()
    kernel._running = True


def moved(axis, degrees):
    return tuple(joint + (degrees if index == axis else 0.0) for index, joint in enumerate(HOME))


def test_at_rest_friction_has_the_direction_of_the_approach(make):
    scene, kernel = make()
    weight = scene.world.holding_currents(HOME)
    go(scene, kernel, moved(1, -1.0))
    go(scene, kernel, HOME)
    from_below = scene.motor_currents()
    go(scene, kernel, moved(1, 1.0))
    go(scene, kernel, HOME)
    from_above = scene.motor_currents()
    assert from_below[1] > weight[1] + 0.2
    assert from_above[1] < weight[1] - 0.2
    assert (from_below[1] + from_above[1]) / 2.0 == pytest.approx(weight[1], abs=1e-9)
    assert from_below[2:] == from_above[2:]  # those axes have not moved


def test_the_brakes_close_some_time_after_standstill_and_the_currents_are_zero_then(make):
    scene, kernel = make()
    scene.currents.brakes_after_ns = 3 * S
    go(scene, kernel, moved(1, -1.0))
    rest = scene.arm.standing_since()
    assert any(scene.motor_currents(rest + 3 * S - 1))
    assert not scene.currents.brakes_closed(rest + 3 * S - 1)
    assert scene.motor_currents(rest + 3 * S) == (0.0,) * 6
    run_to(kernel, rest + 4 * S)
    scene.arm.move(HOME, 50.0, lambda: None)
    assert not scene.currents.brakes_closed()
    assert any(scene.motor_currents())


def test_a_restarted_cell_shows_the_same_currents(make, tmp_path):
    memory = Memory(tmp_path / "state.json")
    scene, kernel = make(memory)
    go(scene, kernel, moved(1, -1.0))
    before = scene.motor_currents()
    memory.save()
    again, _ = make(Memory(tmp_path / "state.json"))
    assert again.motor_currents() == pytest.approx(before, abs=1e-9)
