"""The part of the robot that comes near to touched objects: forearm, wrist, and the tool with its wire."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from cellctl.kinematics import JointMap, SerialChain

Array = NDArray[np.float64]


@final
@dataclass(frozen=True, slots=True)
class Thickness:
    """Thickness of the robot, mm: radius of forearm and wrist, of the tool's shaft, and the length of the thin wire
    outside the shaft; only the wire touches.
    """

    wrist: float = 60.0
    shaft: float = 8.0
    stick_out: float = 25.0


@final
@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """Points (k, 3) on the robot's axis lines at k poses, base frame, mm; `mouth`: the shaft's end, where the wire
    begins.
    """

    elbow: Array
    wrist: Array
    flange: Array
    mouth: Array
    tip: Array


@final
class Body:
    """A robot with `thickness`; the tool is a straight shaft from flange to tip."""

    def __init__(self, chain: SerialChain, joints: JointMap, thickness: Thickness) -> None:
        self.thickness = thickness
        self._chain = chain
        self._joints = joints
        self._elbow, self._wrist = (max(1, chain.n - left) for left in (3, 2))

    def at(self, readings: Array) -> Posture:
        """Its posture at `readings` (k, n), deg, by the nominal model."""
        q = self._joints.model(readings)
        places, tip = self._chain.frames(q)[..., :3, 3], self._chain.forward(q)[:, :3, 3]
        elbow, wrist, flange = (places[:, index] for index in (self._elbow, self._wrist, -1))
        shaft = tip - flange
        length = np.linalg.norm(shaft, axis=-1, keepdims=True)
        mouth = tip - shaft * np.minimum(1.0, self.thickness.stick_out / np.maximum(length, 1e-9))
        return Posture(elbow, wrist, flange, mouth, tip)

    def tip(self, readings: Array) -> Array:
        """The tip alone, (k, 3)."""
        return np.asarray(self._chain.forward(self._joints.model(readings))[:, :3, 3])
