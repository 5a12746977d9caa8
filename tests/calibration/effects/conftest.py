"""An arm of weights on springs, by hand: axes and points at rest, turned one after the other, and statics. No chain."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellctl.kinematics import Link, SerialChain
from tests.helpers.own_model import KR5_TABLE

G = 9.80665

TABLES = {  # theta, d, a, alpha in deg and mm; T = Rz(q + theta) Tz(d) Tx(a) Rx(alpha)
    "one joint, level": (-90, [(0, 120, 500, 0)]),
    "one joint, leaning": (-50, [(20, 80, 400, 10)]),
    "pan and tilt": (0, [(0, 300, 50, -90), (10, 25, 350, 0)]),
    "six joints": (0, KR5_TABLE),
    "seven joints": (
        0,
        [
            (0, 360, 0, -90),
            (0, 0, 0, 90),
            (0, 420, 0, 90),
            (0, 0, 0, -90),
            (0, 400, 0, -90),
            (0, 0, 0, 90),
            (0, 126, 0, 0),
        ],
    ),
}
TOOL = np.array([30.0, -20.0, 150.0])


def _turn(axis, degrees):
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    return matrix


def _slide(x=0.0, y=0.0, z=0.0):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


@dataclass
class Arm:
    """Joint axes (point, direction; mm) and what hangs behind each joint, as they are at model zero.

    lean: the first axis is turned about x by this much from the base's z, deg: a fixed part of the first link's pose.
    down: which way weight pulls, in the base frame.
    """

    lean: float
    rows: list
    down: tuple = (0.0, 0.0, -1.0)

    def __post_init__(self):
        place, self.points, self.axes = _turn("x", self.lean), [], []
        for theta, d, a, alpha in self.rows:
            self.points.append(place[:3, 3])
            self.axes.append(place[:3, 2])
            self.flange = place @ _turn("z", theta) @ _slide(z=d)
            place = self.flange @ _slide(x=a) @ _turn("x", alpha)
        self.tip = (place @ np.append(TOOL, 1.0))[:3]

    @property
    def n(self):
        return len(self.rows)

    def chain(self):
        """The same arm as cellctl has it; the lean is one more fixed row of a Craig table's first link."""
        craig = [(self.lean, 0.0)] + [(alpha, a) for _, _, a, alpha in self.rows]
        links = [
            Link(np.deg2rad(theta), d, a, np.deg2rad(alpha))
            for (theta, d, _, _), (alpha, a) in zip(self.rows, craig, strict=False)
        ]
        end = _slide(x=craig[-1][1]) @ _turn("x", craig[-1][0])
        return SerialChain.from_links("dh-craig", links, None, end @ _slide(*TOOL))

    def moved(self, q, behind, point):
        """A point (3,) that is fixed behind joint `behind` (from 0; −1: the base), at angles q (N, n): (N, 3)."""
        points = np.tile(point, (len(q), 1))
        for joint in range(behind, -1, -1):
            turn = Rotation.from_rotvec(q[:, joint, None] * self.axes[joint])
            points = turn.apply(points - self.points[joint]) + self.points[joint]
        return points

    def directed(self, q, behind, direction):
        """A direction (3,) that is fixed behind joint `behind`, at angles q (N, n): (N, 3)."""
        return self.moved(q, behind, direction) - self.moved(q, behind, np.zeros(3))

    def moments(self, q, weights):
        """Moments (N, n) about the joints, N m, of `weights`: (behind which joint, where at model zero in mm, kg)."""
        result = np.zeros((len(q), self.n))
        for behind, place, kilograms in weights:
            centre = self.moved(q, behind, place)
            weight = G * np.array(self.down) * np.reshape(kilograms, (-1, 1))
            for joint in range(behind + 1):
                lever_m = (centre - self.moved(q, joint - 1, self.points[joint])) / 1000.0
                axis = self.directed(q, joint - 1, self.axes[joint])
                result[:, joint] += np.sum(axis * np.cross(lever_m, weight), axis=1)
        return result

    def links(self, rng):
        """A weight somewhere on each link, kg and mm."""
        return [(k, rng.uniform(-400, 400, 3) + self.points[k], rng.uniform(1, 20)) for k in range(self.n)]


@pytest.fixture(params=list(TABLES))
def arm(request):
    return Arm(*TABLES[request.param])


@pytest.fixture
def six_joints():
    return Arm(*TABLES["six joints"])


@pytest.fixture
def rng():
    return np.random.default_rng(7)
