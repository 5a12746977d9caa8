"""An identified robot as arrays, for a process that corrects a controller's own motion in every cycle.

The arrays hold all parts of a model that are functions of the joints at a constant load and temperature. That process
computes δ with f*(q + δ) = f(q), f the controller's kinematics and f* the identified robot, without fitting code.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.calibration import (
    STANDARD_GRAVITY,
    Backlash,
    Discrepancy,
    Effect,
    Harmonics,
    JointCompliance,
    JointField,
    MotorTorsion,
    Postures,
    RobotModel,
    ThermalExpansion,
    ToolDeflection,
)
from cellctl.kinematics import Floats, JointMap, SerialChain, inverse_pose

Arrays = Mapping[str, tuple[float, ...]]
"""Arrays by name, as `CorrectionModel` of `cellctl.devices` explains them."""

_OWN_WEIGHT = re.compile(r"compliance(\d+)_(\d+)([xy])")
_BY_LOAD = re.compile(r"compliance_load(\d+)")

_LEFT_OUT: Mapping[type[Effect], str] = {
    Backlash: "backlash: each joint is taken midway in its play, as its direction of motion changes on the way",
    MotorTorsion: "flexibility by motor current: on-line correction has no currents",
}


@final
@dataclass(frozen=True, slots=True)
class OnlineArrays:
    """arrays: of the model. left_out: parts of the model that cannot be corrected on-line, in words."""

    arrays: Arrays
    left_out: tuple[str, ...]


def online_arrays(
    identified: RobotModel, joints: JointMap, lower: Floats, upper: Floats, fade_deg: float, at: Postures | None = None
) -> OnlineArrays:
    """The arrays of `identified`, whose base and tool count from the nominal poses of its chain.

    lower, upper (n,): measured region, controller readings, deg; fade_deg: outside it the correction fades to zero over
    this width. at: one posture with the payload and temperature difference that hold throughout; None: neither.
    Raises ValueError for an effect that cannot be computed on-line.
    """
    chain = identified.chain
    bare = chain.with_parameters({}).with_base(np.eye(4))
    conditions = Postures(np.zeros((1, chain.n))) if at is None else at
    of_effects = _Effects(bare, conditions)
    start = len(chain.parameters)
    for effect in identified.effects:
        stop = start + len(effect.parameters)
        of_effects.add(effect, identified.deviations[start:stop])
        start = stop
    named = {
        "sign": joints.sign,
        "offset": np.deg2rad(joints.offset),
        "base": chain.base,
        "links": _constants(bare, flange=True),
        "tool": chain.tool,
        "identified": _constants(chain, flange=False),
        "identified_base": chain.base_now[:3, :3],
        **of_effects.arrays(),
        "lower": lower,
        "upper": upper,
        "fade": np.array([fade_deg]),
    }
    arrays = {name: tuple(np.ravel(values).astype(float).tolist()) for name, values in named.items()}
    return OnlineArrays(arrays, tuple(of_effects.left_out))


def _constants(chain: SerialChain, *, flange: bool) -> Floats:
    """C0 … Cn (n + 1, 4, 4) of C0 Rz(q1) C1 … Rz(qn) Cn, up to the flange or the TCP: steps between frames at q = 0."""
    home = np.zeros(chain.n)
    frames = chain.frames(home)
    ends = [*frames[:-1], frames[-1] if flange else chain.forward(home)]
    return np.array([ends[0], *(inverse_pose(a) @ b for a, b in itertools.pairwise(ends))])


@final
class _Effects:
    """The effects' part of the arrays, added up. Bare: the nominal chain in its own base frame."""

    def __init__(self, bare: SerialChain, at: Postures) -> None:
        n = bare.n
        self.left_out: list[str] = []
        self._bare, self._at = bare, at
        self._down = np.array([0.0, 0.0, -1.0])
        self._weight, self._load, self._stretch = np.zeros((n, 2, n)), np.zeros(n), np.zeros(n + 1)
        self._bend = 0.0
        self._waves: list[tuple[float, float, float, float]] = []
        self._nodes: list[tuple[Floats, Floats, Floats]] = []

    def add(self, effect: Effect, amounts: Floats) -> None:
        """Add an effect with its amounts (K,). Raises ValueError for one that is not known here."""
        match effect:
            case JointCompliance():
                self._down = np.array(effect.down)
                self._comply(dict(zip((each.name for each in effect.parameters), amounts.tolist(), strict=True)))
            case ToolDeflection():
                self._down = np.array(effect.down)
                self._bend += float(amounts[0]) * float(
                    np.ravel(effect.mm_per_unit + effect.mm_by_payload(self._at))[0]
                )
            case ThermalExpansion():
                self._expand(effect, amounts)
            case Harmonics():
                for (joint, order), (sine, cosine) in zip(effect.waves, amounts.reshape(-1, 2).tolist(), strict=True):
                    self._waves.append((joint - 1, order, sine, cosine))
            case JointField() | Discrepancy():
                self._nodes.extend(_nodes(effect, amounts.reshape(-1, 3)))
            case _ if type(effect) in _LEFT_OUT:
                self.left_out.append(_LEFT_OUT[type(effect)])
            case _:
                raise ValueError(f"the model's {effect.group} cannot be computed on-line; fit one without it")

    def arrays(self) -> dict[str, Floats]:
        """By name."""
        n = self._bare.n
        waves = np.array(self._waves).reshape(-1, 4).T
        places, scales, weights = ([node[part] for node in self._nodes] for part in range(3))
        payload_at = self._at.payload_at
        return {
            "down": self._down,
            "weight": self._weight,
            "load": self._load,
            "load_place": self._bare.tool[:3, 3] if payload_at is None else payload_at[0],
            "bend": np.array([self._bend]),
            "stretch": self._stretch,
            **dict(zip(("wave_joint", "wave_order", "wave_sine", "wave_cosine"), waves, strict=True)),
            "node_place": np.concatenate([np.zeros((0, n)), *places]),
            "node_scale": np.concatenate([np.zeros((0, n)), *scales]),
            "node_weight": np.concatenate([np.zeros((0, 3)), *weights]).T,
        }

    def _comply(self, amounts: Mapping[str, float]) -> None:
        payload_kg = 0.0 if self._at.payload is None else float(self._at.payload[0])
        for name, amount in amounts.items():
            if own := _OWN_WEIGHT.fullmatch(name):
                self._weight[int(own[2]) - 1, "xy".index(own[3]), int(own[1]) - 1] += amount
            elif by_load := _BY_LOAD.fullmatch(name):
                self._load[int(by_load[1]) - 1] += amount * payload_kg * STANDARD_GRAVITY / 1000.0

    def _expand(self, effect: ThermalExpansion, amounts: Floats) -> None:
        """Link i reaches from the frame behind joint i (the first: from the base) to that behind joint i + 1."""
        if self._at.delta_t is None:
            self.left_out.append("thermal expansion: no temperature was given, corrected for 20 °C")
            return
        grown = amounts * float(self._at.delta_t[0])
        for parameter, amount in zip(effect.parameters, grown.tolist(), strict=True):
            link = int(parameter.name.removeprefix("growth"))
            self._stretch[link] += amount
            if link > 1:
                self._stretch[link - 1] -= amount


def _nodes(effect: JointField | Discrepancy, amounts: Floats) -> Iterator[tuple[Floats, Floats, Floats]]:
    """Places and scales of the kernels (M, n), per rad, and their weights (M, 3), mm, from amounts (M, 3)."""
    if isinstance(effect, Discrepancy):
        scale = np.full_like(effect.centres, 1.0 / effect.length_rad)
        yield effect.centres * scale, scale, effect.basis.kernel_weights(amounts)
        return
    for axis, (basis, lengths) in enumerate(zip(effect.bases, effect.lengths, strict=True)):
        weights = np.zeros((len(effect.centres), 3))
        weights[:, axis] = basis.kernel_weights(amounts[:, axis])
        yield basis.centres, np.tile(1.0 / lengths, (len(effect.centres), 1)), weights
