"""The laser station in a whole scene, on a real pseudo-terminal: true places, bytes counted, hosts that come and go."""

import os
import time
from dataclasses import replace
from math import atan2, cos, hypot, sin

import numpy as np
import pytest

from sims.bench import catalogue, setup_of
from sims.cell import read_cell
from sims.faults import Faults
from sims.geocom._description import SIMULATOR
from sims.kernel import Kernel
from sims.memory import Memory
from sims.simulator import CannotStart
from sims.simulators import installed
from tests.helpers.station import write_cell

PATIENCE_S = 60


class Line:
    """A laser station on a kernel that a test turns, and a host's end of the line."""

    def __init__(self, cell, memory=None):
        self.kernel = Kernel("lockstep")
        self.setup = setup_of(cell, "tracker", self.kernel, Faults(self.kernel, catalogue()), memory=memory)
        self.scene = self.setup.scene
        self.server = SIMULATOR.start(self.setup)
        self.fd, self._begun, self._number = -1, b"", 0
        self.sent = self.heard = 0

    def open(self):
        self.fd = os.open(self.server.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._begun = b""
        return self

    def hang_up(self):
        os.close(self.fd)
        self.fd = -1
        self.turn(20)

    def turn(self, times=1):
        for _ in range(times):
            self.kernel._heard_at = time.monotonic_ns()
            self.kernel._lockstep_turn()

    def send(self, text):
        self.sent += os.write(self.fd, text.encode())

    def ask(self, rpc, *parameters):
        self._number += 1
        self.send(f"%R1Q,{rpc},{self._number}:{','.join(map(str, parameters))}\r\n")
        head, _, tail = self.read().partition(":")
        assert head == f"%R1P,0,{self._number}"
        code, *values = tail.split(",")
        return int(code), [float(value) for value in values if value[0] != '"']

    def read(self):
        until = time.monotonic() + PATIENCE_S
        while b"\r\n" not in self._begun:
            assert time.monotonic() < until, "no reply"
            self.turn()
            try:
                data = os.read(self.fd, 4096)
            except BlockingIOError:
                continue
            self.heard += len(data)
            self._begun += data
        line, self._begun = self._begun.split(b"\r\n", 1)
        return line.decode()

    def wait(self, seconds):
        over = self.kernel.after(round(seconds * 1e9), lambda: None)
        while over.pending:
            self.turn()

    def move(self, *joints):
        """The robot, at a tenth of its speed."""
        arrived = []
        self.scene.arm.move(tuple(map(float, joints)), 10.0, lambda: arrived.append(True))
        while not arrived:
            self.turn()

    def aim_at(self, place):
        """By the file's rough frame of the station, as a host would."""
        x, y, z = place
        assert self.ask(18005, 1) == (0, [])
        assert self.ask(9027, atan2(x, y), atan2(hypot(x, y), z), 0, 0, 0) == (0, [])
        return self.ask(9037, 0.06, 0.06, 0)[0]

    def measure(self):
        assert self.ask(2008, 3, 1) == self.ask(2008, 1, 1) == (0, [])
        code, (hz, v, metres) = self.ask(2108, 20_000, 1)
        assert code == 0
        return 1e3 * metres * np.array([sin(v) * sin(hz), sin(v) * cos(hz), cos(v)])

    def close(self):
        if self.fd >= 0:
            os.close(self.fd)
        self.server.close()
        self.kernel.close()


@pytest.fixture
def cell_of(request, tmp_path):
    def make(devices=None, **simulate):
        return read_cell(write_cell(request.config.rootpath, tmp_path, devices, **simulate), to_run=True)

    return make


@pytest.fixture
def line_of(cell_of):
    lines = []

    def make(memory=None, devices=None, **simulate):
        lines.append(Line(cell_of(devices, **simulate), memory))
        return lines[-1]

    yield make
    for line in lines:
        line.close()


def in_station(line, place):
    """A place of the base frame in the frame of the levelled instrument at its true place."""
    frame = line.scene.station()
    up = frame[:3, :3].T @ np.array(line.scene.world.up)
    inside = (np.linalg.inv(frame) @ [*place, 1.0])[:3]
    return _turned(up, inside)


def _turned(up, place):
    """The smallest rotation that takes `up` to z, by Rodrigues' formula on matrices."""
    x, y, z = up
    cross = np.array([[0.0, 0.0, -x], [0.0, 0.0, -y], [x, y, 0.0]])
    return place + cross @ place + cross @ cross @ place / (1.0 + z)


def test_it_measures_the_true_places_of_nests_and_robot_in_its_own_levelled_frame(line_of):
    settings = {"noise_scale": 0.0, "collimation_arcsec": 0.0, "index_arcsec": 0.0}
    line = line_of(seed=4, tracker=settings).open()
    assert line.ask(17008, 9) == line.ask(2024, -0.0038) == (0, [])
    assert line.ask(2028, 0.658, 1013.25, 20.0, 13.3) == (0, [])  # 45 % by Sprung's formula
    assert line.scene.tilt > 0.005
    targets = {one.id: one.xyz for one in line.scene.reflectors()}
    for name in ("N1", "N2", "N3", "R1"):
        expected = in_station(line, targets[name])
        assert line.aim_at(expected + 5.0) == 0, name
        assert line.measure() == pytest.approx(expected, abs=2e-3), name


def test_a_lock_follows_the_moving_robot_and_is_lost_when_the_reflector_turns_away(line_of):
    line = line_of(tracker={"noise_scale": 0.0, "collimation_arcsec": 0.0, "index_arcsec": 0.0}).open()

    def reflector():
        return in_station(line, line.scene.reflectors()[0].xyz)

    line.ask(17008, 9)
    line.ask(2024, -0.0038)
    line.ask(18007, 1)
    assert line.aim_at(reflector()) == 0
    assert line.ask(9013) == (0, [])
    before = reflector()
    line.move(10, -90, 90, 0, 45, 0)
    assert np.linalg.norm(reflector() - before) > 100
    assert line.ask(6021) == (0, [1])
    assert line.measure() == pytest.approx(reflector(), abs=0.05)  # the air is not set
    line.move(10, -90, 90, 0, 45, 120)
    assert line.ask(6021) == (0, [2])
    line.wait(2.0)
    assert line.ask(6021) == (0, [0])
    assert line.aim_at(reflector()) == 8710


def test_every_byte_of_both_directions_is_counted(line_of):
    line = line_of().open()
    line.setup.wire.begin()
    for _ in range(3):
        line.ask(5004)
    assert line.setup.wire.has_read(line.sent)
    assert not line.setup.wire.has_read(line.sent + 1)
    assert line.setup.wire.written == line.heard


def test_the_address_has_the_terminals_path_and_keeps_its_settings(line_of):
    line = line_of()
    assert line.server.address == f"geocom+serial://{line.server.path}?baud=115200&accuracy=tdra6000"
    assert line.server.path.startswith("/dev/pts/")


def test_a_reply_for_a_host_that_hung_up_does_not_reach_the_next_one(line_of):
    line = line_of().open()
    line.ask(0)
    line.send("%R1Q,5004,77:\r\n")
    line.turn(1)
    line.hang_up()
    line.open()
    assert line.ask(0) == (0, [])
    assert not line.setup.wire.has_read(10_000)


def test_the_next_process_goes_on_with_the_next_reading(line_of, tmp_path):
    def measured(line, count):
        line.open()
        assert line.aim_at(in_station(line, line.scene.reflectors()[1].xyz)) == 0
        return [tuple(line.measure()) for _ in range(count)]

    path = tmp_path / "memory.json"
    whole = measured(line_of(), 3)
    first = line_of(memory=Memory(path))
    before = measured(first, 2)
    first.setup.memory.save()
    (after,) = measured(line_of(memory=Memory(path)), 1)
    assert before == whole[:2]
    assert after == whole[2]


def test_a_cell_without_a_station_cannot_have_a_laser_station(cell_of, kernel):
    cell = replace(cell_of(), station=None)
    setup = setup_of(cell, "tracker", kernel, Faults(kernel, catalogue()))
    with pytest.raises(CannotStart, match="station:"):
        SIMULATOR.start(setup)


@pytest.mark.parametrize("query", ["baud=0", "baud=fast", "accuracy=best"])
def test_a_wrong_address_is_refused(query):
    (error,) = installed().problems({"tracker": f"geocom+serial:///dev/ttyUSB0?{query}"})
    assert error.startswith("devices.tracker: ")
    assert query.partition("=")[0] in error


def test_the_settings_may_name_another_noise_than_the_address(line_of):
    line = line_of(tracker={"noise": "at960"}).open()
    line.send("%R1Q,5004,1:\r\n")
    assert line.read() == '%R1P,0,1:0,"SIM-AT960 noise only"'
