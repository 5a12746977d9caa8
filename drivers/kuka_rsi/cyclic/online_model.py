"""The joint correction that makes the identified robot reach the nominal robot's TCP pose, one Newton step a cycle.

f is the controller's kinematics, f* the identified robot: links, joint stiffness under weight and load, waves of gears,
bending, and a field over the joints. Sought is δ with f*(q + δ) = f(q). Each cycle makes one damped step from the last
cycle's δ with the Jacobian of f: δ ← δ + J⁺(q)(f(q) − f*(q + δ)). From δ = 0 three steps leave less than 1 µm; from
one cycle to the next δ changes by some 0.1 mm at 100 deg/s, and one step leaves 3 µm of that at most.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias, final

from drivers.kuka_rsi.axes import AXES
from drivers.kuka_rsi.cyclic.model_arrays import unpack

Array: TypeAlias = Any
"""Of numpy, which is imported with the first model only."""

_DAMPING_MM = 10.0
"""Of the least squares step: a singular direction is left alone. Elsewhere one step leaves 1 % more at most."""

_LEVER_MM = 500.0
"""A radian of the TCP's orientation counts as so many millimetres in the damping."""

_MOST_RAD = math.radians(5.0)
"""No calibration error is larger: at a singularity the steps end here, and find back."""


@final
class OnlineModel:
    """The corrections of one model. `values`: as `pack` made them. Raises ValueError where it did not.

    The first one imports numpy (0.2 s): before the session, when no telegram waits.
    """

    def __init__(self, values: Sequence[float], last_rad: Sequence[float] | None = None) -> None:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        import numpy as np

        self._np = np
        parts = unpack(values)
        arrays = {name: np.array(part, float) for name, part in parts.items()}
        self._lower, self._upper = list(parts["lower"]), list(parts["upper"])
        self._fade_deg = max(float(parts["fade"][0]), 1e-6)
        self._sign, self._offset = arrays["sign"], arrays["offset"]
        self._base, self._tool = arrays["base"].reshape(4, 4), arrays["tool"].reshape(4, 4)
        links, identified = arrays["links"].reshape(-1, 4, 4), arrays["identified"].reshape(-1, 4, 4)
        self._nominal = _Chain(np, links)
        self._true = _Chain(np, identified)
        self._true_turn = arrays["identified_base"].reshape(3, 3)
        self._down = arrays["down"]
        self._down_across = _cross_matrix(np, arrays["down"])
        self._weight = arrays["weight"].reshape(2 * AXES, AXES)
        self._load, self._load_place = arrays["load"], np.append(arrays["load_place"], 1.0)
        self._loaded = bool(self._load.any())
        self._bend, self._stretch = float(parts["bend"][0]), arrays["stretch"]
        self._stretched = bool(self._stretch.any())
        self._waves, self._nodes = _Waves(np, arrays), _Nodes(np, arrays)
        self._lever = np.array([1.0, 1.0, 1.0, _LEVER_MM, _LEVER_MM, _LEVER_MM])
        self._damping = _DAMPING_MM**2 * np.eye(6)
        self._last = np.zeros(AXES) if last_rad is None else np.array(last_rad, float)

    @property
    def last_rad(self) -> tuple[float, ...]:
        """The last correction of the model angles, rad: the start of the next step."""
        return tuple(self._last.tolist())

    def inside(self, readings: Sequence[float]) -> float:
        """1 within the measured region, falling smoothly to 0 at the fade width outside it. readings: A1…A6, deg."""
        beyond = 0.0
        for low, reading, high in zip(self._lower, readings, self._upper, strict=True):
            beyond = max(beyond, low - reading, reading - high)
        share = max(0.0, 1.0 - beyond / self._fade_deg)
        return share * share * (3.0 - 2.0 * share)

    def correction(self, readings: Sequence[float]) -> tuple[float, ...]:
        """The correction of A1…A6, deg, at the programmed joints `readings`, deg, one step from the last cycle's."""
        np = self._np
        q = self._sign * np.radians(readings) + self._offset
        corrected = q + self._last
        frames, behind = self._nominal.frames(np.stack([q, corrected]))
        goal = self._base @ frames[-1] @ self._tool
        rest = _difference(np, goal, self._pose(corrected, behind)) * self._lever
        arms = _jacobian(np, self._base, frames, goal) * self._lever[:, None]
        step = arms.T @ np.linalg.solve(arms @ arms.T + self._damping, rest)
        self._last = np.clip(self._last + step, -_MOST_RAD, _MOST_RAD)
        return tuple((self._sign * np.degrees(self._last)).tolist())

    def _pose(self, q: Array, frames: Array) -> Array:
        """The identified robot's TCP (4, 4), mm, in the measuring frame, at model angles q (6,), rad. frames (7, 4, 4):
        of the nominal robot in its own base.
        """
        true = self._true.frames((q + self._turns(q, frames))[None])[0, -1]
        true[:3, 3] += self._true_turn @ self._shift(q, frames)
        return true

    def _turns(self, q: Array, frames: Array) -> Array:
        """Turns of the joints (6,), rad, by weight, load and waves."""
        arms = self._down_across @ frames[:-1, :3, 2].T
        pulls = frames[:-1, :3, :2].transpose(1, 0, 2).reshape(3, 2 * AXES) @ self._weight
        turns = (arms * pulls).sum(axis=0)
        if self._loaded:
            place = frames[-1, :3] @ self._load_place
            turns = turns + self._load * (arms * (place[:, None] - frames[:-1, :3, 3].T)).sum(axis=0)
        return turns + self._waves.turns(q)

    def _shift(self, q: Array, frames: Array) -> Array:
        """Shift of the TCP (3,), mm, along the robot's base: bending, expansion, field."""
        np = self._np
        shift = np.zeros(3)
        if self._bend:
            along = frames[-1, :3, 2]
            shift += self._bend * (self._down - (self._down @ along) * along)
        if self._stretched:
            shift += self._stretch @ frames[:, :3, 3]
        return shift + self._nodes.shift(q)


@final
class _Waves:
    """Σ s sin mq + c (cos mq − 1) of each joint."""

    def __init__(self, np: Any, arrays: Mapping[str, Array]) -> None:
        self._np = np
        joint, count = arrays["wave_joint"].astype(int), arrays["wave_joint"].size
        self._orders, self._sines = np.zeros((count, AXES)), np.zeros((AXES, count))
        self._cosines = np.zeros((AXES, count))
        each = np.arange(count)
        self._orders[each, joint] = arrays["wave_order"]
        self._sines[joint, each], self._cosines[joint, each] = arrays["wave_sine"], arrays["wave_cosine"]
        self._constant = self._cosines.sum(axis=1)

    def turns(self, q: Array) -> Array:
        """Of the joints (6,), rad."""
        phase = self._orders @ q
        return self._sines @ self._np.sin(phase) + self._cosines @ self._np.cos(phase) - self._constant


@final
class _Nodes:
    """Σ w exp(−½ |q · scale − place|²), the square multiplied out: two products of a matrix and a vector."""

    def __init__(self, np: Any, arrays: Mapping[str, Array]) -> None:
        self._np = np
        place, scale = (arrays[each].reshape(-1, AXES) for each in ("node_place", "node_scale"))
        self._factors = np.hstack([scale * place, -0.5 * scale**2])
        self._constant = -0.5 * (place**2).sum(axis=1)
        self._weight = arrays["node_weight"].reshape(3, -1)

    def shift(self, q: Array) -> Array:
        """Of the TCP (3,), mm, along the robot's base."""
        np = self._np
        return self._weight @ np.exp(self._factors @ np.concatenate([q, q * q]) + self._constant)


@final
class _Chain:
    """C0 Rz(q1) C1 … Rz(q6) C6 of constants (7, 4, 4): the frames behind the joints, and the end."""

    def __init__(self, np: Any, constants: Array) -> None:
        self._np = np
        self._before, self._end = constants[:-1].copy(), constants[-1].copy()
        self._across = self._before[:, :, [1, 0]] * np.array([1.0, -1.0])

    def frames(self, q: Array) -> Array:
        """(N, 7, 4, 4), mm, at angles q (N, 6), rad. A turn about z mixes the first two columns of the frame before."""
        np = self._np
        cosine, sine = np.cos(q)[:, :, None, None], np.sin(q)[:, :, None, None]
        steps = np.empty((len(q), AXES, 4, 4))
        steps[:, :, :, :2] = cosine * self._before[:, :, :2] + sine * self._across
        steps[:, :, :, 2:] = self._before[:, :, 2:]
        result = np.empty((len(q), AXES + 1, 4, 4))
        result[:, 0] = steps[:, 0]
        for joint in range(1, AXES):
            np.matmul(result[:, joint - 1], steps[:, joint], out=result[:, joint])
        np.matmul(result[:, AXES - 1], self._end, out=result[:, AXES])
        return result


def _difference(np: Any, goal: Array, actual: Array) -> Array:
    """Shift, mm, and small rotation vector, rad, (6,) from pose `actual` to `goal`."""
    turn = goal[:3, :3] @ actual[:3, :3].T
    rotation = (turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
    return np.concatenate([goal[:3, 3] - actual[:3, 3], 0.5 * np.array(rotation)])


def _jacobian(np: Any, base: Array, frames: Array, end: Array) -> Array:
    """Of the TCP by the joints (6, 6), mm and rad per rad, in the measuring frame."""
    carried = base[:3, :3] @ frames[:-1, :3, 2].T
    places = base[:3, :3] @ frames[:-1, :3, 3].T + base[:3, 3:]
    arms = end[:3, 3:] - places
    result = np.empty((6, AXES))
    result[0] = carried[1] * arms[2] - carried[2] * arms[1]
    result[1] = carried[2] * arms[0] - carried[0] * arms[2]
    result[2] = carried[0] * arms[1] - carried[1] * arms[0]
    result[3:] = carried
    return result


def _cross_matrix(np: Any, vector: Array) -> Array:
    """M (3, 3) with M x = vector × x."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
