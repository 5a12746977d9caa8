"""A serial arm, its errors, measurements, prior and posterior, written out for tests with nothing of cellctl's.

`OwnArm` is made of 4×4 products of an mdh-hayati table, mm and rad. One link is Rz(q + theta) Tz(d) Tx(a) Rx(alpha)
Ry(beta), the whole base · T1 … Tn · tool. A parameter is a number added to its entry of the table; of base and tool,
the motion Tx Ty Tz Rz(a) Ry(b) Rx(c) behind the given pose.

`JointErrors` are errors of a real robot's joints that no table of links has: gravity, encoders, and all the rest; they
say how far joints are from where the controller reads them, and the arm adds them to its angles. `OwnRows` are what was
measured in a simulated set-up, and how far an arm is from it in standard deviations. `scipys_optimum` is SciPy's
optimum of the posterior by finite differences. The `forward_of_…` functions are forward kinematics from the text of a
robot file, a URDF or a DH table: 4×4, mm.
"""

from __future__ import annotations

import csv
import io
import math
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Protocol

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

KR5_TABLE = [(0, 400, 180, -90), (0, 0, 600, 0), (-90, 0, 40, -90), (0, 620, 0, 90), (180, 0, 0, 90), (0, 80, 0, 0)]
"""KUKA KR5 R1400 as published (Wang et al. 2024, doi 10.3390/app14219824).

theta, d, a, alpha of each link, deg and mm: Rz(q + theta) Tz(d) Tx(a) Rx(alpha)."""

Floats = NDArray[np.float64]
CARRYING = (1, 2, 4)
"""Joints (from 0) that carry weight: shoulder, elbow, and the wrist's bend."""
MASSES = np.array([0.0, 30.0, 25.0, 10.0, 5.0, 4.0])
"""kg, each at the end of its link; only how the torque is shared matters, its size is `yielding`."""
SAG_RAD = (1e-4, 4e-4)
ENCODER_RAD = (1e-4, 3e-4)
SMOOTH_RAD = (0.5e-4, 1.5e-4)
SMOOTH_OVER_RAD = 1.5
"""How far joints move until the smooth error has forgotten what it was."""
WAVES = 40

COLUMNS = ("theta", "d", "a", "alpha", "beta")
FRAME_LETTERS = "xyzabc"

X, Y, Z = np.eye(3)


class ErrorsOfJoints(Protocol):
    """What joints do besides what a table of links says."""

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        """By how much (N, n), rad, joints are beyond q (N, n); `links`: see `JointErrors.at`."""
        ...


@dataclass(frozen=True, eq=False)
class JointErrors:
    """Of n joints. yielding (n,): sag under the greatest torque, rad. encoder (2, n), phase (2, n): amplitude, rad, and
    phase of what returns once and twice a turn. smooth (n,): 1 σ, rad, of an error that depends on all joints; waves
    (W, n), 1/rad, and shares (n, W, 2): the cosines and sines that it is the sum of.
    """

    yielding: Floats
    encoder: Floats
    phase: Floats
    smooth: Floats
    waves: Floats
    shares: Floats

    @classmethod
    def drawn(cls, seed: int, n: int = 6) -> JointErrors:
        """As large as in an industrial robot; each size even in its range."""
        rng = np.random.default_rng([seed, 17])
        yielding = np.zeros(n)
        yielding[list(CARRYING)] = rng.uniform(*SAG_RAD, len(CARRYING))
        return cls(
            yielding=yielding,
            encoder=rng.uniform(*ENCODER_RAD, (2, n)),
            phase=rng.uniform(0.0, 2.0 * np.pi, (2, n)),
            smooth=np.full(n, rng.uniform(*SMOOTH_RAD)),
            waves=rng.normal(0.0, 1.0 / SMOOTH_OVER_RAD, (WAVES, n)),
            shares=rng.normal(0.0, 1.0 / np.sqrt(WAVES), (n, WAVES, 2)),
        )

    def at(self, q: Floats, links: Callable[[Floats], Floats]) -> Floats:
        """By how much (N, n), rad, joints are beyond q (N, n); `links`: poses (N, n + 1, 4, 4), mm, of the base and
        behind each joint, z upwards.
        """
        turn = q @ self.waves.T
        smooth = self.smooth * (np.cos(turn) @ self.shares[..., 0].T + np.sin(turn) @ self.shares[..., 1].T)
        encoder = sum(self.encoder[k] * np.sin((k + 1) * q + self.phase[k]) for k in range(2))
        return np.asarray(smooth + encoder + self.yielding * gravity_shares(links(q)))


def gravity_shares(poses: Floats) -> Floats:
    """Torque of gravity (N, n) about each joint that carries weight, of the greatest that its links stretched out would
    give; 0 about others. poses: as of `JointErrors.at`.
    """
    ends, result = poses[:, 1:, :3, 3], np.zeros((len(poses), poses.shape[1] - 1))
    for joint in CARRYING:
        axis, origin = poses[:, joint, :3, 2], poses[:, joint, :3, 3]
        arms, weights = ends[:, joint:] - origin[:, None], MASSES[joint:]
        torque = np.cross(arms, [0.0, 0.0, -1.0]) * weights[:, None]
        most = float(np.sum(np.linalg.norm(arms, axis=2).max(axis=0) * weights))
        result[:, joint] = np.sum(torque.sum(axis=1) * axis, axis=1) / max(most, 1e-9)
    return result


def pose_of(rotation: Rotation, place: Sequence[float] | Floats) -> Floats:
    """The pose (4, 4) of a rotation and a place (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), place
    return matrix


def small_motion(six: Floats) -> Floats:
    """Tx Ty Tz Rz(a) Ry(b) Rx(c) as a pose (4, 4)."""
    a, b, c = six[3:]
    matrix = about_z(a) @ about_y(b) @ about_x(c)
    matrix[:3, 3] = six[:3]
    return matrix


def about_x(angle: float) -> Floats:
    """Rx as a pose (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]], float)


def about_y(angle: float) -> Floats:
    """Ry as a pose (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0, s, 0], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]], float)


def about_z(angle: float) -> Floats:
    """Rz as a pose (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], float)


def six_of(motion: Floats) -> Floats:
    """x, y, z, a, b, c (6,) of a pose (4, 4): the inverse of `small_motion`."""
    return np.concatenate([motion[:3, 3], Rotation.from_matrix(motion[:3, :3]).as_euler("ZYX")])


@dataclass(frozen=True, eq=False)
class OwnArm:
    """table (n, 5): theta, d, a, alpha, beta. hayati: numbers of links with beta in place of d. bend: c_t, 1/(N·m²);
    sag_mm: how far a horizontal tool hangs down for c_t = 1. joint_errors: what its joints do besides, if anything.
    """

    table: Floats
    hayati: frozenset[int] = frozenset()
    base: Floats = field(default_factory=lambda: np.eye(4))
    tool: Floats = field(default_factory=lambda: np.eye(4))
    bend: float = 0.0
    sag_mm: float = 0.0
    joint_errors: ErrorsOfJoints | None = None

    @property
    def link_names(self) -> tuple[str, ...]:
        """The table's parameters by name: theta1, d1, a1, alpha1, …"""
        return tuple(
            f"{kind}{number}"
            for number in range(1, len(self.table) + 1)
            for kind in COLUMNS
            if kind != ("d" if number in self.hayati else "beta")
        )

    def flange(self, q: Floats) -> Floats:
        """Flange poses (N, 4, 4) at joint angles q (N, n)."""
        if self.joint_errors is not None:
            q = q + self.joint_errors.at(q, self.links)
        return self.base @ self.links(q)[:, -1]

    def links(self, q: Floats) -> Floats:
        """The robot's base, z upwards, and the poses behind each of its joints in it (N, n + 1, 4, 4), at angles that
        the joints have.
        """
        cosines, sines = np.cos(q + self.table[:, 0]), np.sin(q + self.table[:, 0])
        joint = np.zeros((len(q), *self.table.shape[:1], 4, 4))
        joint[..., 0, 0], joint[..., 0, 1], joint[..., 1, 0], joint[..., 1, 1] = cosines, -sines, sines, cosines
        joint[..., 2, 2] = joint[..., 3, 3] = 1.0
        reached = [np.broadcast_to(np.eye(4), (len(q), 4, 4))]
        for number, (_, d, a, alpha, beta) in enumerate(self.table.tolist()):
            behind = about_x(alpha) @ about_y(beta)
            behind[:3, 3] = a, 0.0, d
            reached.append(reached[-1] @ (joint[:, number] @ behind))
        return np.stack(reached, axis=1)

    def poses(self, q: Floats) -> Floats:
        """Tool poses (N, 4, 4), with the shift by bending."""
        flange = self.flange(q)
        result = flange @ self.tool
        if self.bend:
            down, axis = -self.base[:3, 2], flange[:, :3, 2]
            result[:, :3, 3] += self.bend * self.sag_mm * (down - (axis @ down)[:, None] * axis)
        return result

    def points(self, q: Floats) -> Floats:
        """Tool centre points (N, 3)."""
        return self.poses(q)[:, :3, 3]

    def moved(self, names: Sequence[str], values: Sequence[float] | Floats) -> OwnArm:
        """This arm with `values` added to the parameters `names`; names of anything but arms are passed over."""
        table, frames, bend = self.table.copy(), {"base": np.zeros(6), "tool": np.zeros(6)}, self.bend
        for name, value in zip(names, values, strict=True):
            if link := re.fullmatch(r"(theta|d|a|alpha|beta)(\d+)", name):
                table[int(link[2]) - 1, COLUMNS.index(link[1])] += value
            elif part := re.fullmatch(r"(base|tool)_([xyzabc])", name):
                frames[part[1]][FRAME_LETTERS.index(part[2])] += value
            elif name == "tool_deflection":
                bend += value
        base, tool = self.base @ small_motion(frames["base"]), self.tool @ small_motion(frames["tool"])
        return replace(self, table=table, base=base, tool=tool, bend=float(bend))

    def reaching(self, points: Floats, start: Floats) -> Floats:
        """Angles (N, n) that put the tool centre points at `points` (N, 3), the wrist as in `start` (Newton)."""
        q = start.copy()
        for _ in range(12):
            sides = [(self.points(q + h) - self.points(q - h)) / 2e-6 for h in 1e-6 * np.eye(q.shape[1])[:3]]
            step = np.einsum("njk,nk->nj", np.linalg.pinv(np.stack(sides, axis=-1)), self.points(q) - points)
            q[:, :3] -= np.clip(step, -0.3, 0.3)
        return q

    def held(self, poses: Floats, start: Floats) -> Floats:
        """Angles (N, 6) that put the tool at `poses` (N, 4, 4) near `start` (Newton on position and rotation)."""
        q = start.copy()
        for _ in range(40):
            away = self._away(q, poses)
            sides = [(self._away(q + h, poses) - self._away(q - h, poses)) / 2e-6 for h in 1e-6 * np.eye(q.shape[1])]
            q -= np.clip(np.einsum("njk,nk->nj", np.linalg.pinv(np.stack(sides, axis=-1)), away), -0.3, 0.3)
        return q

    def _away(self, q: Floats, poses: Floats) -> Floats:
        """Place and turn (N, 6) from `poses` to the tool; mm and 0.001 rad."""
        now = self.poses(q)
        turn = Rotation.from_matrix(now[:, :3, :3] @ np.swapaxes(poses[:, :3, :3], -1, -2)).as_rotvec()
        return np.concatenate([now[:, :3, 3] - poses[:, :3, 3], 1000.0 * turn], axis=1)


def turns(name: str) -> bool:
    """Whether a parameter is an angle, rad."""
    return bool(re.fullmatch(r"(theta|alpha|beta)\d+|(base|tool)_[abc]", name))


def kr5() -> OwnArm:
    """The KUKA KR5 R1400 as published, its torch as the tool."""
    torch = pose_of(Rotation.from_euler("ZYX", [38.846, 3.595, 0.040], degrees=True), [59.9, 50.5, 410.3])
    weight = 1.535 * 9.80665
    return OwnArm(_table(KR5_TABLE), frozenset({2}), tool=torch, sag_mm=1000.0 * 0.4103**3 / 3.0 * weight)


def ur10() -> OwnArm:
    """The Universal Robots UR10 as its maker publishes it, no tool."""
    rows = [
        (0, 127.3, 0, 90),
        (0, 0, -612, 0),
        (0, 0, -572.3, 0),
        (0, 163.941, 0, 90),
        (0, 115.7, 0, -90),
        (0, 92.2, 0, 0),
    ]
    return OwnArm(_table(rows), frozenset({2, 3}))


def _table(rows: Sequence[tuple[float, float, float, float]]) -> Floats:
    theta, d, a, alpha = np.array(rows, float).T
    return np.stack([np.radians(theta), d, a, np.radians(alpha), np.zeros(len(rows))], axis=1)


class OwnRows(Protocol):
    """Measurements at joint angles q (N, n)."""

    @property
    def q(self) -> Floats: ...

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        """(Model − measurement) / σ, in one row; centres (S, 3) of the spheres, if there are any."""
        ...


@dataclass(frozen=True, eq=False)
class OwnPositions:
    """Points xyz (N, 3), mm, with the same σ on each axis."""

    q: Floats
    xyz: Floats
    sigma_mm: float

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        del centres
        return ((arm.points(self.q) - self.xyz) / self.sigma_mm).ravel()


@dataclass(frozen=True, eq=False)
class OwnPoses:
    """Poses (N, 4, 4) with the same σ on each axis, mm, and about each axis, rad."""

    q: Floats
    poses: Floats
    sigma_mm: float
    sigma_rad: float

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        del centres
        now = arm.poses(self.q)
        turn = small_turn(now[:, :3, :3] @ np.swapaxes(self.poses[:, :3, :3], -1, -2))
        away = (now[:, :3, 3] - self.poses[:, :3, 3]) / self.sigma_mm
        return np.concatenate([away, turn / self.sigma_rad], axis=1).ravel()


@dataclass(frozen=True, eq=False)
class OwnTouches:
    """Touches: the tip is `reach` (mm) from the centre of sphere (N,). Certified distances between pairs, mm."""

    q: Floats
    sphere: NDArray[np.intp]
    reach: float
    sigma_mm: float
    spacings: Floats
    spacing_sigma_mm: float

    @staticmethod
    def pairs(spheres: int) -> NDArray[np.intp]:
        """Index pairs of all spacings."""
        return np.array(list(combinations(range(spheres), 2)), dtype=np.intp)

    def misfit(self, arm: OwnArm, centres: Floats) -> Floats:
        off = np.linalg.norm(arm.points(self.q) - centres[self.sphere], axis=1) - self.reach
        return np.concatenate([off / self.sigma_mm, (between(centres) - self.spacings) / self.spacing_sigma_mm])


def between(centres: Floats) -> Floats:
    """Distances of all pairs of centres."""
    first, second = OwnTouches.pairs(len(centres)).T
    return np.asarray(np.linalg.norm(centres[first] - centres[second], axis=1))


def small_turn(rotation: Floats) -> Floats:
    """Axis times angle (N, 3), rad, of rotations (N, 3, 3) below a right angle, through the sine."""
    skew = np.stack([rotation[:, i, j] - rotation[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1) / 2.0
    sine = np.linalg.norm(skew, axis=1, keepdims=True)
    return np.asarray(skew * np.where(sine > 1e-9, np.arcsin(np.minimum(sine, 1.0)) / np.maximum(sine, 1e-9), 1.0))


@dataclass(frozen=True)
class OwnPrior:
    """1 σ of each kind of parameter about the table; flat: of what nothing is known, mm and rad."""

    link_mm: float = 0.5
    angle_deg: float = 0.05
    joint_zero_deg: float = 0.05
    tool_mm: float = 2.0
    deflection: float = 0.002
    flat_mm: float = 1000.0
    flat_rad: float = 1.0

    def sigma(self, name: str, flat: Sequence[str]) -> float:
        """1 σ of a parameter; flat where its name begins with one of `flat`."""
        if name.startswith(tuple(flat)):
            return self.flat_rad if turns(name) else self.flat_mm
        if name == "tool_deflection":
            return self.deflection
        if re.fullmatch(r"theta\d+", name):
            return float(np.radians(self.joint_zero_deg))
        if turns(name):
            return float(np.radians(self.angle_deg))
        return self.tool_mm if name.startswith("tool_") else self.link_mm


@dataclass(frozen=True, eq=False)
class Unknown:
    """Names (F,) of what is free, prior σ (F,), and the arm and centres (S, 3) from which deviations count."""

    names: tuple[str, ...]
    sigma: Floats
    start: OwnArm
    centres: Floats

    def arm(self, deviations: Floats) -> OwnArm:
        """The arm at `deviations` (F,)."""
        return self.start.moved(self.names, deviations)

    def centres_at(self, deviations: Floats) -> Floats:
        """The spheres' centres (S, 3) at `deviations` (F,): the last of them."""
        return self.centres + deviations[len(deviations) - self.centres.size :].reshape(-1, 3)

    def columns(self, deviations: Floats, q: Floats) -> Floats:
        """How the tool centre points at angles q (N, n) move with the deviations (N, 3, F), by central differences."""
        steps = np.diag([1e-6 if turns(name) else 1e-4 for name in self.names])
        ahead, behind = ([self.arm(deviations + side * step).points(q) for step in steps] for side in (1.0, -1.0))
        return np.asarray(
            np.moveaxis((np.array(ahead) - np.array(behind)) / (2.0 * np.diag(steps))[:, None, None], 0, -1)
        )


def scipys_optimum(unknown: Unknown, rows: OwnRows) -> Floats:
    """Most probable deviations (F,): least squares of misfit and prior, derivatives by SciPy's own differences."""

    def residual(scaled: Floats) -> Floats:
        deviations = scaled * unknown.sigma
        return np.concatenate([rows.misfit(unknown.arm(deviations), unknown.centres_at(deviations)), scaled])

    start = np.zeros(len(unknown.names))
    found = least_squares(residual, start, jac="2-point", method="lm", xtol=1e-10, ftol=1e-12)
    return np.asarray(found.x * unknown.sigma)


def deviations_between(names: Sequence[str], start: OwnArm, arm: OwnArm, start_at: Floats, centres: Floats) -> Floats:
    """By how much (F,) `arm` and `centres` (S, 3) deviate from `start` and `start_at`, named parameters only."""
    frames = {
        "base": six_of(np.linalg.inv(start.base) @ arm.base),
        "tool": six_of(np.linalg.inv(start.tool) @ arm.tool),
    }
    values = dict(zip(start.link_names, _entries(arm) - _entries(start), strict=True))
    values |= {f"{frame}_{letter}": six[i] for frame, six in frames.items() for i, letter in enumerate("xyzabc")}
    values["tool_deflection"] = arm.bend - start.bend
    away = centres - start_at
    values |= {f"S{s + 1}_{axis}": row[i] for s, row in enumerate(away) for i, axis in enumerate("xyz")}
    return np.array([0.0 if name.startswith("discrepancy") else values[name] for name in names])


def _entries(arm: OwnArm) -> Floats:
    columns = ("theta", "d", "a", "alpha", "beta")
    places = [re.fullmatch(r"(\D+)(\d+)", name) for name in arm.link_names]
    return np.array([arm.table[int(place[2]) - 1, columns.index(place[1])] for place in places if place])


def turn(axis, angle, point=(0.0, 0.0, 0.0)):
    """A turn (rad) about an axis through a point, after Rodrigues."""
    x, y, z = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    result = np.eye(4)
    result[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    result[:3, 3] = point - result[:3, :3] @ np.asarray(point, float)
    return result


def slide(vector):
    result = np.eye(4)
    result[:3, 3] = vector
    return result


def kuka_frame(frame):
    a, b, c = np.deg2rad(frame.get("abc", [0, 0, 0]))
    return slide(frame.get("xyz", [0, 0, 0])) @ turn(Z, a) @ turn(Y, b) @ turn(X, c)


def link(row, angle, convention):
    theta, alpha, beta = (np.deg2rad(float(row.get(name) or 0.0)) for name in ("theta", "alpha", "beta"))
    joint = turn(Z, angle + theta) @ slide([0, 0, float(row.get("d") or 0.0)])
    along = slide([float(row.get("a") or 0.0), 0, 0])
    behind = turn(X, alpha) @ along @ turn(Y, beta)
    return joint @ behind if convention == "mdh-hayati" else behind @ joint


def forward_of_robot_file(text, readings):
    robot = yaml.safe_load(text)
    here = kuka_frame(robot.get("base", {}))
    angles = [
        np.deg2rad(joint.get("sign", 1) * reading + joint.get("offset", 0))
        for joint, reading in zip(robot["joints"], readings, strict=True)
    ]
    if robot["convention"] == "poe":
        for screw, angle in zip(robot["screws"], angles, strict=True):
            here = here @ turn(screw["axis"], angle, screw["point"])
        here = here @ kuka_frame(robot["home"])
    else:
        for row, angle in zip(robot["links"], angles, strict=True):
            here = here @ link(row, angle, robot["convention"])
    return here @ kuka_frame(robot.get("tool", {}))


def forward_of_urdf(text, tip, readings_rad):
    """Joint positions, rad or m, in the order of the chain from the root to `tip`."""
    root = ElementTree.fromstring(text)
    above = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    path = []
    while tip in above:
        path.insert(0, above[tip])
        tip = above[tip].find("parent").get("link")
    here, positions = np.eye(4), iter(readings_rad)
    for joint in path:
        origin = joint.find("origin")
        if origin is not None:
            roll, pitch, yaw = map(float, origin.get("rpy", "0 0 0").split())
            here = here @ slide([1000.0 * float(word) for word in origin.get("xyz", "0 0 0").split()])
            here = here @ turn(Z, yaw) @ turn(Y, pitch) @ turn(X, roll)
        if joint.get("type") != "fixed":
            axis = joint.find("axis")
            along = np.array(list(map(float, axis.get("xyz").split())) if axis is not None else X)
            if joint.get("type") == "prismatic":
                here = here @ slide(1000.0 * next(positions) * along / np.linalg.norm(along))
            else:
                here = here @ turn(along.tolist(), next(positions))
    assert next(positions, None) is None
    return here


def forward_of_dh_table(text, readings):
    rows = list(csv.DictReader(io.StringIO(text)))
    frames = {
        row["joint"]: kuka_frame({"xyz": [float(row[n]) for n in "XYZ"], "abc": [float(row[n]) for n in "ABC"]})
        for row in rows
        if row["joint"] in ("base", "tool")
    }
    here = frames.get("base", np.eye(4))
    for row, reading in zip((row for row in rows if row["joint"] not in frames), readings, strict=True):
        moved = float(row["sign"] or 1) * reading + float(row["offset"] or 0)
        if row.get("type") == "prismatic":
            row["d"] = str(float(row["d"] or 0.0) + moved)
        here = here @ link(row, 0.0 if row.get("type") == "prismatic" else np.deg2rad(moved), row["convention"])
    return here @ frames.get("tool", np.eye(4))


def assert_same_pose(found, wanted):
    np.testing.assert_allclose(found[:3, 3], wanted[:3, 3], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[:3, :3], wanted[:3, :3], rtol=0, atol=1e-12)
