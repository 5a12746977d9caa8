"""Functions of URScript that only compute: numbers, lists, texts, poses. Named and called as in the script manual."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import final

from sims.ur import _poses
from sims.ur._script_expressions import PoseValue, ScriptError, Value, shown


@final
class DataFunctions:
    """Each public method is a function of URScript. `seed`: of `random`."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(f"{seed} URScript")

    def acos(self, f: float) -> float:
        return math.acos(f)

    def asin(self, f: float) -> float:
        return math.asin(f)

    def atan(self, f: float) -> float:
        return math.atan(f)

    def atan2(self, x: float, y: float) -> float:
        return math.atan2(x, y)

    def ceil(self, f: float) -> int:
        return math.ceil(f)

    def cos(self, f: float) -> float:
        return math.cos(f)

    def d2r(self, d: float) -> float:
        return math.radians(d)

    def floor(self, f: float) -> int:
        return math.floor(f)

    def log(self, b: float, f: float) -> float:
        return math.log(f, b)

    def pow(self, base: float, exponent: float) -> float:
        return float(base**exponent)

    def r2d(self, r: float) -> float:
        return math.degrees(r)

    def random(self) -> float:
        return self._random.random()

    def sin(self, f: float) -> float:
        return math.sin(f)

    def sqrt(self, f: float) -> float:
        return math.sqrt(f)

    def tan(self, f: float) -> float:
        return math.tan(f)

    def norm(self, a: Value) -> float:
        """Of a number, or of a list as a vector."""
        return math.hypot(*a) if isinstance(a, list) else abs(float(a))

    def length(self, v: Value) -> int:
        """Of a list or a text."""
        return len(v)

    def get_list_length(self, v: Value) -> int:
        return len(v)

    def integer_to_binary_list(self, x: int) -> list[Value]:
        """32 bits, the least significant first."""
        return [bool(x >> i & 1) for i in range(32)]

    def binary_list_to_integer(self, x: Sequence[bool]) -> int:
        return sum(1 << i for i, bit in enumerate(x) if bit)

    def to_num(self, s: str) -> Value:
        return float(s) if any(sign in s for sign in ".eE") else int(s)

    def to_str(self, v: Value) -> str:
        return shown(v)

    def str_at(self, src: str, index: int) -> str:
        return src[index]

    def str_cat(self, op1: str, op2: str) -> str:
        return _text(op1) + _text(op2)

    def str_empty(self, s: str) -> bool:
        return not s

    def str_find(self, src: str, target: str, start_from: int = 0) -> int:
        return src.find(target, start_from)

    def str_len(self, s: str) -> int:
        return len(s)

    def str_sub(self, src: str, index: int, len: int = -1) -> str:  # noqa: A002  # URScript's own name
        return src[index:] if len < 0 else src[index : index + len]

    def pose_trans(self, p_from: Value, p_from_to: Value) -> PoseValue:
        return PoseValue(_poses.trans(pose(p_from), pose(p_from_to)))

    def pose_inv(self, p_from: Value) -> PoseValue:
        return PoseValue(_poses.inverse(pose(p_from)))

    def pose_add(self, p_1: Value, p_2: Value) -> PoseValue:
        """Places are added, rotations multiplied."""
        a, b = _poses.matrix_of(pose(p_1)), _poses.matrix_of(pose(p_2))
        return PoseValue((*(a[:3, 3] + b[:3, 3]).tolist(), *_poses.vector_of(a[:3, :3] @ b[:3, :3])))

    def pose_sub(self, p_to: Value, p_from: Value) -> PoseValue:
        """Places are subtracted, the rotation from one to the other."""
        a, b = _poses.matrix_of(pose(p_to)), _poses.matrix_of(pose(p_from))
        return PoseValue((*(a[:3, 3] - b[:3, 3]).tolist(), *_poses.vector_of(a[:3, :3] @ b[:3, :3].T)))

    def pose_dist(self, pose_from: Value, pose_to: Value) -> float:
        return math.dist(pose(pose_from)[:3], pose(pose_to)[:3])

    def point_dist(self, from_: Value, to: Value) -> float:
        return math.dist(pose(from_)[:3], pose(to)[:3])

    def interpolate_pose(self, p_from: Value, p_to: Value, alpha: float) -> PoseValue:
        return PoseValue(_poses.between(pose(p_from), pose(p_to), alpha))

    def rotvec2rpy(self, rotation_vector: Sequence[float]) -> list[Value]:
        """Roll, pitch, yaw: about X, Y, Z of the fixed frame."""
        r = _poses.rotation_of(rotation_vector)
        return [
            math.atan2(float(r[2, 1]), float(r[2, 2])),
            math.asin(max(-1.0, min(1.0, -float(r[2, 0])))),
            math.atan2(float(r[1, 0]), float(r[0, 0])),
        ]

    def rpy2rotvec(self, rpy: Sequence[float]) -> list[Value]:
        x, y, z = rpy
        about = [_poses.rotation_of(vector) for vector in ((0, 0, z), (0, y, 0), (x, 0, 0))]
        return list(_poses.vector_of(about[0] @ about[1] @ about[2]))


def pose(value: Value) -> list[float]:
    """Of a pose. Raises ScriptError."""
    if not isinstance(value, PoseValue):
        raise ScriptError(f"Type error: a pose is expected, not {shown(value)}")
    return value


def _text(value: Value) -> str:
    return value if isinstance(value, str) else shown(value)
