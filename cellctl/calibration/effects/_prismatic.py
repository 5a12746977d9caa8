"""Errors of a prismatic joint (rail, lift, quill): its scale, and its straightness and rotations along the travel."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np
from numpy.polynomial import legendre

from cellctl.calibration.model.effect import Effect, EffectInputs
from cellctl.calibration.model.parameter import MM, RAD, Group, Parameter, Phrase, Unit
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.residual_model import ResidualModel
from cellctl.kinematics import Bools, Floats, SerialChain

SCALE = 3e-4
"""1 σ of a scale about 0: racks of several pieces have some 0.1 mm/m, a gear's pitch entered in round numbers more;
steel at 20 °C more or less has 2.4e-4."""

OF_ONE = Unit("1", "ppm", 1e6)
_SCALE_PHRASE = Phrase.of("scale", "joint")


@final
@dataclass(frozen=True)
class JointScale(Effect):
    """The scale of each prismatic joint: it moves by (1 + s) times what it reads, from its model zero.

    joints: the prismatic ones, from 1. `scale{j}`, a pure number. A revolute joint has none: its turn is a turn.
    needs: rows along the travel, and a length in them.
    """

    joints: tuple[int, ...]
    expected: float = SCALE

    group: ClassVar[Group] = "scale"
    title: ClassVar[str] = "Scale of prismatic joints"
    needs: ClassVar[str] = "this robot has no prismatic joint"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect, if any joint is prismatic."""
        joints = _numbers(setup.chain.prismatic)
        return cls(joints) if joints else None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """One for each prismatic joint."""
        return tuple(
            Parameter(f"scale{j}", OF_ONE, self.group, f"A{j} scale", _SCALE_PHRASE, str(j), j) for j in self.joints
        )

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0."""
        return np.full(len(self.joints), self.expected)

    def suits(self, joints: int) -> bool:
        """Whether a robot with so many joints has these."""
        return max(self.joints) <= joints

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, K): each joint's own coordinate, m per unit."""
        result = np.zeros((len(at), nominal.n, len(self.joints)))
        for column, j in enumerate(self.joints):
            result[:, j - 1, column] = at.q[:, j - 1]
        return result


OFFSETS = tuple(range(2, 9))
"""Orders of the polynomials of straightness: 0 and 1 are the base's place and the axis' direction. Order 8 follows
waves of a third of the travel."""

ROTATIONS = tuple(range(1, 7))
"""The same of the rotations; 0 is the base's."""

STRAIGHT_MM = 0.2
"""1 σ of straightness, RMS over the travel: rails that are levelled on a floor keep 0.1 to 0.5 mm over some metres."""

ROTATES_RAD = 2e-4
"""1 σ of each rotation, RMS over the travel: 0.1 mm across the half metre between two rails, or along a carriage."""

LEAST_TRAVEL_M = 0.01
"""A joint that covers less than this in the rows shows no shape."""

_STRAIGHT = Phrase.of("straightness", "joint")
_ROTATION = Phrase.of("rotation along the travel", "joint", 1)


@final
@dataclass(frozen=True)
class Straightness(ResidualModel):
    """What a carriage does besides its motion along a straight line, as smooth functions of its place.

    Shift along and rotation about the three axes of the frame behind the joint: the six errors of a linear axis (ISO
    230-1: EXX, EYX, EZX, EAX, EBX, ECX), each a sum of Legendre polynomials in u = −1 … 1 over the travel, each of RMS
    1. Variances fall with the square of the order. A rotation ω shifts the TCP by ω × lever; the TCP's own
    rotation by ω, some hundredths of a degree, is left out.

    joints: the prismatic ones, from 1. low, high: the ends of each one's travel in the rows, m; outside of it the
    errors stay as at the end. `straight{j}_{x,y,z}{m}`, mm; `rotation{j}_{x,y,z}{m}`, rad.
    needs: rows along the travel.
    """

    joints: tuple[int, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    straight_mm: float = STRAIGHT_MM
    rotates_rad: float = ROTATES_RAD
    _amounts: tuple[tuple[int, str, str, int], ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not len(self.joints) == len(self.low) == len(self.high):
            raise ValueError("straightness has a lower and an upper end of each joint")
        if not all(low < high for low, high in zip(self.low, self.high, strict=True)):
            raise ValueError("the travel of a joint ends above its begin")
        kinds = (("straight", OFFSETS), ("rotation", ROTATIONS))
        amounts = ((j, kind, axis, m) for j in self.joints for kind, orders in kinds for axis in "xyz" for m in orders)
        object.__setattr__(self, "_amounts", tuple(amounts))

    group: ClassVar[Group] = "straightness"
    title: ClassVar[str] = "Straightness of prismatic joints"
    needs: ClassVar[str] = "this robot has no prismatic joint that moves in these rows"

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect, if any prismatic joint moves."""
        low, high = setup.at.q.min(axis=0, initial=np.inf), setup.at.q.max(axis=0, initial=-np.inf)
        joints = _numbers(setup.chain.prismatic & (high - low > LEAST_TRAVEL_M))
        begins, ends = (tuple(float(each[j - 1]) for j in joints) for each in (low, high))
        return cls(joints, begins, ends) if joints else None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Joint by joint, the shifts (mm), then the rotations (rad)."""
        return tuple(
            Parameter(
                f"{kind}{j}_{axis}{m}",
                MM if kind == "straight" else RAD,
                self.group,
                f"A{j} {'straightness' if kind == 'straight' else 'rotation'} {axis}, order {m}",
                _STRAIGHT if kind == "straight" else _ROTATION,
                str(j),
                j,
                band=f"{'straightness' if kind == 'straight' else 'rotations'} of joint {j}",
            )
            for j, kind, axis, m in self._amounts
        )

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0: the variances 1/m² of a function's orders share its own."""
        sizes = {"straight": self.straight_mm / _total(OFFSETS), "rotation": self.rotates_rad / _total(ROTATIONS)}
        return np.array([sizes[kind] / m for _, kind, _, m in self._amounts])

    def suits(self, joints: int) -> bool:
        """Whether a robot with so many joints has these."""
        return max(self.joints) <= joints

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats:
        """Ψ (N, 3, K): along the axes of each joint's frame, or across its lever to the TCP."""
        frames, tcp = nominal.frames(at.q), nominal.forward(at.q)[:, :3, 3]
        columns = [np.zeros((len(at), 3, 0))]
        for j, low, high in zip(self.joints, self.low, self.high, strict=True):
            place = np.clip((2.0 * at.q[:, j - 1] - low - high) / (high - low), -1.0, 1.0)
            axes = frames[:, j - 1, :3, :3]
            arms = np.cross(axes, (tcp - frames[:, j - 1, :3, 3])[:, :, None], axisa=1, axisb=1, axisc=1)
            for directions, orders in ((axes, OFFSETS), (arms, ROTATIONS)):
                shapes = legendre.legvander(place, orders[-1])[:, orders] * np.sqrt(2.0 * np.array(orders) + 1.0)
                columns.append((directions[..., None] * shapes[:, None, None, :]).reshape(len(at), 3, 3 * len(orders)))
        return np.concatenate(columns, axis=2)


def _numbers(which: Bools) -> tuple[int, ...]:
    """The joints, from 1, at a mask (n,)."""
    return tuple((np.flatnonzero(which) + 1).tolist())


def _total(orders: tuple[int, ...]) -> float:
    """√Σ 1/m²."""
    return float(np.sqrt(np.sum(1.0 / np.square(orders))))
