"""A serial arm written out for tests: 4×4 products of an mdh-hayati table, nothing of cellctl's chain. mm and rad.

One link is Rz(q + theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), the whole base · T1 … Tn · tool. A parameter is a number added
to its entry of the table; of base and tool, the motion Tx Ty Tz Rz(a) Ry(b) Rx(c) behind the given pose.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.helpers.kr5_table import KR5_TABLE
from tests.helpers.own_effects import JointErrors

Floats = NDArray[np.float64]

COLUMNS = ("theta", "d", "a", "alpha", "beta")
FRAME_LETTERS = "xyzabc"


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
    joint_errors: JointErrors | None = None

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
            q = q + self.joint_errors.at(q, self._upright)
        return self.base @ self._upright(q)[:, -1]

    def _upright(self, q: Floats) -> Floats:
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
