"""A robot of the tests' own, measured in every way there is, and what cellctl makes of that; mm and rad.

The robot is a KR5 with errors from the prior, its tool somewhere near where it was taught, at a place that nobody
knows. Truth and measurements are `own_model`'s; `Campaign` hands them on as rows, and `shape_error` judges a model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cellctl.calibration import (
    Estimate,
    PlaneRows,
    PositionRows,
    RobotModel,
    SocketRows,
    SpacingRows,
    TouchRows,
    sigma_among,
)
from cellctl.kinematics import Link, SerialChain
from tests.helpers.own_model import Floats, OwnArm, kr5, pose_of, small_motion
from tests.helpers.simulated_setups import KR5_REGION, KR5_SIGNS, erroneous

Indices: TypeAlias = NDArray[np.intp]

REACH = 31.3
STARTS = KR5_SIGNS * np.radians([0.0, -70.0, 80.0, 0.0, 60.0, 0.0])


def nominal_of(arm: OwnArm) -> RobotModel:
    """An arm as cellctl has it, without effects."""
    links = [
        Link(theta, d, a, alpha, beta if number in arm.hayati else None)
        for number, (theta, d, a, alpha, beta) in enumerate(arm.table.tolist(), start=1)
    ]
    return RobotModel(SerialChain.from_links("mdh-hayati", links, arm.base, arm.tool))


@dataclass(frozen=True, eq=False)
class Campaign:
    """A robot to be measured. nominal: as the robot file has it; truth: as it is, its base at `truth.base`."""

    rng: np.random.Generator
    nominal: OwnArm
    truth: OwnArm

    @classmethod
    def of(cls, seed: int, tool_mm: float = 2.0) -> Campaign:
        """A robot with errors from the prior at a place unlike its nominal one."""
        rng = np.random.default_rng([seed, 11])
        nominal = kr5()
        truth = erroneous(rng, nominal, nominal.link_names)
        truth = truth.moved(("tool_x", "tool_y", "tool_z"), rng.normal(0.0, tool_mm, 3))
        return cls(rng, nominal, replace(truth, base=place(rng)))

    def asked(self, count: int = 60) -> Floats:
        """Angles (count, 6) all over the region."""
        return self.rng.uniform(KR5_REGION[0], KR5_REGION[1], (count, 6))

    def positions(self, count: int, sigma: float, said: float | None = None, session: int = 0) -> PositionRows:
        """What a tracker sees of the tool centre point; `said`: the σ that the rows claim, if it is another."""
        q = self.asked(count)
        xyz = self.truth.points(q) + self.rng.normal(0.0, sigma, (count, 3))
        return PositionRows(q, xyz, np.full((count, 3), said or sigma), session)

    def touches(self, count: int, centres: Floats, sigma: float, said: float | None = None) -> TouchRows:
        """Touches in turn on spheres at `centres` (S, 3), mm, in the robot's base."""
        point = np.arange(count) % len(centres)

        def goals(left: Indices) -> Floats:
            away = self.rng.normal(size=(len(left), 3))
            away /= np.linalg.norm(away, axis=1, keepdims=True)
            return np.asarray(centres[left] + (REACH + self.rng.normal(0.0, sigma, (len(left), 1))) * away)

        q = self.standing(point, goals)
        return TouchRows(q, point, np.full(count, REACH), np.full((count, 1), said or sigma))

    def planes(self, count: int, planes: Floats, sigma: float, ball: float = 0.0, first: int = 0) -> PlaneRows:
        """Touches in turn on planes (S, 6): a point of each, mm, in the robot's base, and its unit normal; by a ball of
        radius `ball`, anywhere within 300 mm of the point, the flange on the side of the normal as in any real touch.
        """
        point = np.arange(count) % len(planes)

        def goals(left: Indices) -> Floats:
            place, normal = planes[left, :3], planes[left, 3:]
            beside = self.rng.uniform(-300.0, 300.0, (len(left), 3))
            beside -= np.sum(beside * normal, axis=1, keepdims=True) * normal
            return np.asarray(place + beside + (ball + self.rng.normal(0.0, sigma, (len(left), 1))) * normal)

        q = self.standing(point, goals, planes[:, 3:])
        return PlaneRows(q, first + point, np.full(count, ball), np.full((count, 1), sigma))

    def sockets(self, count: int, places: Floats, sigma: float, first: int = 0, session: int = 0) -> SocketRows:
        """Visits in turn to sockets at `places` (S, 3), mm, in the robot's base, called `first`, `first` + 1, …"""
        point = np.arange(count) % len(places)
        q = self.standing(point, lambda left: places[left] + self.rng.normal(0.0, sigma, (len(left), 3)))
        return SocketRows(q, first + point, np.full((count, 3), sigma), session)

    def distances(self, count: int, anchor: Floats, sigma: float, point: int) -> TouchRows:
        """Distances by a ball-bar or wire from an anchor (3,), mm, in the robot's base, to the tool anywhere."""
        q = self.asked(count)
        reach = np.linalg.norm(self._in_base(q) - anchor, axis=1) + self.rng.normal(0.0, sigma, count)
        return TouchRows(q, np.full(count, point), reach, np.full((count, 1), sigma))

    def _in_base(self, q: Floats) -> Floats:
        return replace(self.truth, base=np.eye(4)).points(q)

    def standing(self, point: Indices, goals: Callable[[Indices], Floats], sides: Floats | None = None) -> Floats:
        """Angles (N, 6) that put the tool at `goals(point)` (in the robot's base), the wrist anyhow, the flange on the
        side (S, 3) of each point where that matters.
        """
        arm, q, left = replace(self.truth, base=np.eye(4)), np.zeros((len(point), 6)), np.arange(len(point))
        while left.size:
            goal = goals(point[left])
            shaken = self.rng.uniform(-25, 25, (left.size, 6)) * [1, 1, 1, 3, 1, 4]
            start = STARTS + KR5_SIGNS * np.radians(shaken)
            found = arm.reaching(goal, start)
            good = np.linalg.norm(arm.points(found) - goal, axis=1) < 1e-9
            good &= (np.abs(found[:, :3] - start[:, :3]) < 1.5).all(axis=1)
            if sides is not None:
                good &= np.sum((arm.flange(found)[:, :3, 3] - goal) * sides[point[left]], axis=1) > 50.0
            q[left[good]] = found[good]
            left = left[~good]
        return q


def place(rng: np.random.Generator) -> Floats:
    """A place (4, 4) in an instrument's frame."""
    return pose_of(Rotation.random(random_state=rng), rng.uniform(-2000.0, 2000.0, 3))


def shaken(rng: np.random.Generator, pose: Floats, mm: float, rad: float) -> Floats:
    """A pose (4, 4) a little off."""
    return pose @ small_motion(rng.normal(0.0, [mm] * 3 + [rad] * 3))


def certificate(rng: np.random.Generator, points: Floats, pairs: list[tuple[int, int]], sigma: float) -> SpacingRows:
    """Certified distances between points (S, 3)."""
    first, second = np.array(pairs).T
    mm = np.linalg.norm(points[first] - points[second], axis=1) + rng.normal(0.0, sigma, len(pairs))
    return SpacingRows(np.array(pairs), mm, np.full((len(pairs), 1), sigma))


def shape_error(found: Estimate, truth: OwnArm, q: Floats) -> tuple[float, float]:
    """RMS of the true 3-D error at angles q (N, 6) without what moves all points as one body, and the σ said of it."""
    model, robot = found.state.model, found.unknowns.robot
    return body_error(model.tcp(q), truth.points(q)), sigma_among(model, found.covariance[:robot, :robot], q)


def body_error(points: Floats, true: Floats) -> float:
    """RMS 3-D distance, mm, of points (N, 3) from the true ones, the best rigid motion taken off."""
    a, b = points - points.mean(axis=0), true - true.mean(axis=0)
    turn, _ = Rotation.align_vectors(b, a)
    return float(np.sqrt(np.mean(np.sum((turn.apply(a) - b) ** 2, axis=1))))
