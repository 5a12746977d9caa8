"""Joints turn a little under the weight that they carry: gears, bearings and drives are springs.

The weight behind joint j pulls at it by the moment ẑ_j · Σ_{k≥j} (p_k − o_j) × m_k g ĝ. Each lever p_k − o_j is a sum
of vectors fixed in the frames behind joints j … k, so the moment is ẑ_j · Σ_{k≥j} (R_k s_k) × ĝ with constants s_k:
masses times lengths, never needed singly. The part of s_k along z belongs to the frame before, as joint k's axis
does not turn with joint k; a part along joint j's own axis has no moment about it. That leaves two amounts
for each k ≥ j, and these are independent: only the pair of k, not a pair before it, rotates with joint k. The same
regrouping gives the minimum inertial parameters of a robot at rest (Gautier and Khalil 1990, Direct calculation of
minimum set of inertial parameters of serial robots).
A joint whose axis is vertical at every posture carries no moment and has no amounts: joint 1 of a robot on the floor or
under a ceiling, none on a wall.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self, final

import numpy as np

from cellctl.calibration.model.effect import (
    DOWN,
    STANDARD_GRAVITY,
    Direction,
    Effect,
    EffectInputs,
    OnlineTerms,
    prismatic_field,
    prismatic_joints,
)
from cellctl.calibration.model.parameter import RAD, Group, Parameter, Phrase, Unit
from cellctl.calibration.model.postures import Postures, varies
from cellctl.kinematics import Floats, SerialChain

SAG_RAD = 3e-4
"""What a joint turns by under the moment of the link behind it, 1 σ; an estimate for arms of 5 to 20 kg payload.

A UR10's shoulder carries 90 N m (the maker's masses) on a gear of some 2e5 N m/rad: 4e-4. Fitted to its measured rows
(ipa-robot-accuracy data set), joints 2 and 3 have 0.2e-4 … 4e-4.
"""

SHRINKS = 0.5
"""Expected ratio of this from one link to the next further out: 90, 34, 4, 1 N m in that UR10, and its tool besides."""

SAG_PER_NM = 3e-5
"""1 σ of 1/stiffness, rad/(N m): robot gears have 1e4 (wrist) … 1e6 N m/rad; an estimate as well."""

UPRIGHT_RAD = 1e-4
"""An axis that leans less than this is vertical, in a table with rounded angles: weight does not turn it."""

PER_NM = Unit("rad/(N m)", "µrad/(N·m)", 1e6)
_PHRASE = Phrase.of("compliance", "joint")
_UNDER_LOAD = Phrase.of("compliance under load", "joint", 1)


@final
@dataclass(frozen=True)
class JointCompliance(Effect):
    """Joints as torsion springs under gravity: what each turns by the weight of the links, and by a known payload.

    joints: how many. load_known: whether the rows state their payload. upright: joints (from 1) whose axis is vertical
    at every posture, which have no amounts; `of` finds them. down: ĝ in the robot's base frame. prismatic: joints (from
    1) without a spring; moments that are fixed in the frame behind one are fixed in the frame before it, too.
    `compliance{j}_{k}x`, `…y`: rad by which joint j turns under the weight moment that is fixed along x, y of the
    frame behind joint k, where that lies level and across joint j's axis. `compliance_load{j}`: rad/(N m) of joint j
    under the payload. Positive is the direction of the weight's moment.
    needs: rows at which the weight pulls differently, and for the payload's amounts rows with different payloads (one
    that never changes is a part of the links' weight).
    """

    joints: int
    load_known: bool = False
    upright: frozenset[int] = frozenset()
    down: Direction = DOWN
    prismatic: frozenset[int] = prismatic_field()

    @classmethod
    def of(cls, nominal: SerialChain, load_known: bool = False, down: Direction = DOWN) -> Self:
        """The compliance of a robot, without the joints that never carry weight.

        Wherever `nominal` has its base: weight pulls along `down` of that.
        """
        return cls(nominal.n, load_known, _upright(nominal, down), down, prismatic_joints(nominal))

    group: ClassVar[Group] = "compliance"
    title: ClassVar[str] = "Joint compliance"
    needs: ClassVar[str] = "every joint axis of this robot is vertical at all postures: gravity turns none of them"
    missing: ClassVar = (("payload", "no column payload: predicted for none"),)

    @classmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect, if any joint carries weight; with the payload's amounts where the payload changes."""
        effect = cls.of(setup.chain, varies(setup.at.payload), setup.down)
        return effect if effect.parameters else None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Joint by joint, link by link, rad; then the payload's, rad/(N m)."""
        own = (self._own(j + 1, k + 1, "xy"[e]) for j, k, e in self._moments())
        return (*own, *(self._of_payload(j + 1) for j in self._loaded()))

    def _own(self, joint: int, link: int, axis: str) -> Parameter:
        name, label = f"compliance{joint}_{link}{axis}", f"A{joint} sag by link {link}, {axis}"
        return Parameter(name, RAD, self.group, label, _PHRASE, str(joint), joint)

    def _of_payload(self, joint: int) -> Parameter:
        label = f"A{joint} sag by payload"
        return Parameter(f"compliance_load{joint}", PER_NM, self.group, label, _UNDER_LOAD, str(joint), joint)

    def lacks(self, at: Postures) -> list[str]:
        """The payload, where it was not recorded."""
        return super().lacks(at) if self.load_known else []

    @property
    def sigma(self) -> Floats:
        """Prior 1 σ about 0 of each amount."""
        own = [SAG_RAD * SHRINKS ** (k - j) for j, k, _ in self._moments()]
        return np.array(own + [SAG_PER_NM for _ in self._loaded()])

    def turns(self, nominal: SerialChain, at: Postures) -> Floats:
        """Φ (N, n, K): moments about each joint of one newton's weight at unit levers; N m per N m of the payload."""
        frames = np.moveaxis(nominal.frames(at.q), 0, -1)  # each number a long vector, as in the chain itself
        arms, levers = _weight_arms(frames[:-1], self.down), frames[:-1, :3, :2]
        result = np.zeros((self.joints, len(self.parameters), len(at)))
        column = 0
        for joint in self._carrying():
            moments = sum(arms[joint, axis] * levers[self._turning(joint), axis] for axis in range(3))
            result[joint, column : column + 2 * len(moments)] = np.concatenate(moments)
            column += 2 * len(moments)
        if at.payload is not None:
            load = at.payload * _load_arms(nominal, at, frames, arms)
            for extra, joint in enumerate(self._loaded()):
                result[joint, column + extra] = load[joint]
        return np.moveaxis(result, -1, 0)

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """Its springs, under the weight of the links and this load."""
        terms.down, payload_kg = self.down, 0.0 if terms.at.payload is None else float(terms.at.payload[0])
        own = self._moments()
        for (joint, link, axis), amount in zip(own, amounts.tolist(), strict=False):
            terms.weight[link, axis, joint] += amount
        for joint, amount in zip(self._loaded(), amounts[len(own) :].tolist(), strict=True):
            terms.load[joint] += amount * payload_kg * STANDARD_GRAVITY / 1000.0

    def _carrying(self) -> list[int]:
        return [j for j in range(self.joints) if j + 1 not in self.upright | self.prismatic]

    def _moments(self) -> list[tuple[int, int, int]]:
        """Joint, link and direction of each amount of the links' weight, from 0."""
        return [(j, k, e) for j in self._carrying() for k in self._turning(j) for e in range(2)]

    def _turning(self, joint: int) -> list[int]:
        """The revolute joints from `joint` on, from 0."""
        return [k for k in range(joint, self.joints) if k + 1 not in self.prismatic]

    def _loaded(self) -> list[int]:
        return self._carrying() if self.load_known else []


def _weight_arms(frames: Floats, down: Direction) -> Floats:
    """ĝ × ẑ (n, 3, N): ẑ · (lever × ĝ) = lever · (ĝ × ẑ) is the moment of one newton about ẑ."""
    return np.cross(np.array(down)[:, None], frames[:, :3, 2], axisa=0, axisb=1, axisc=1)


def _load_arms(nominal: SerialChain, at: Postures, frames: Floats, arms: Floats) -> Floats:
    """Moments (n, N) about the joints, N m, of the weight of one kilogram at the payload's centre of gravity."""
    levers_m = (_load_places(nominal, at).T - frames[:-1, :3, 3]) / 1000.0
    return np.asarray(STANDARD_GRAVITY * np.sum(arms * levers_m, axis=1))


def _load_places(nominal: SerialChain, at: Postures) -> Floats:
    """Where the payload is (N, 3), mm, in the base frame."""
    if at.payload_at is None:
        return nominal.forward(at.q)[:, :3, 3]
    flange = nominal.forward_flange(at.q)
    return np.asarray(np.einsum("nij,nj->ni", flange[:, :3, :3], at.payload_at) + flange[:, :3, 3])


def _upright(nominal: SerialChain, down: Direction) -> frozenset[int]:
    """Revolute joints (from 1) vertical at every posture: such as come before the first that is not. A prismatic joint
    tilts none of those behind it.
    """
    revolute = ~nominal.prismatic
    axes = nominal.with_base(np.eye(4)).frames(np.zeros(nominal.n))[:-1, :3, 2]
    leaning = revolute & (np.linalg.norm(np.cross(axes, down), axis=-1) > UPRIGHT_RAD)
    return frozenset((np.flatnonzero(revolute & ~np.logical_or.accumulate(leaning)) + 1).tolist())
