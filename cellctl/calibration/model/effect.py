"""The interface of every non-geometric effect, linear in its amounts at nominal joints; and which way weight pulls.

An effect is one file and one line of the tuple `EFFECTS`, or of another package and its entry point. Its class is a
dataclass whose fields are its settings, as a model file has them; other packages use only the attributes below.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.model.parameter import Group, Parameter
from cellctl.calibration.model.postures import Condition, Postures
from cellctl.kinematics import Floats, SerialChain

STANDARD_GRAVITY = 9.80665
"""N/kg."""

Direction: TypeAlias = tuple[float, float, float]
"""A unit vector."""

DOWN: Direction = (0.0, 0.0, -1.0)
"""ĝ in the base frame of a robot on the floor; it differs on a wall, a ceiling or a slope."""


@final
@dataclass(frozen=True, eq=False)
class OwnTurns:
    """Turns where each amount acts on one joint: joints (K,), from 0; values (N, K), rad per unit. For hundreds of
    amounts this takes a sixth of the memory of Φ (N, n, K).
    """

    joints: Any
    values: Floats

    def total(self, amounts: Floats, joints: int) -> Floats:
        """Turn of each joint (N, n), rad, by all amounts (K,) together."""
        result = np.zeros((len(self.values), joints))
        for joint in range(joints):
            mine = self.joints == joint
            result[:, joint] = self.values[:, mine] @ amounts[mine]
        return result

    def columns(self, arms: Floats) -> Floats:
        """How the tool moves (N, 6, K) with the amounts; arms (N, 6, n): with the joints."""
        return np.asarray(arms[:, :, self.joints] * self.values[:, None, :])


WITH_DEFAULT = "with default"
"""Key of a field's metadata: whether model files hold the setting where it has its default; True unless stated."""

STORED = "stored"
"""Key of a field's metadata: the name of a setting in model files, where that is not the field's."""


def prismatic_field() -> frozenset[int]:
    """The field of an effect of revolute joints for the joints (from 1) that are prismatic; stored where there are."""
    return field(default=frozenset(), metadata={WITH_DEFAULT: False})


def prismatic_joints(chain: SerialChain) -> frozenset[int]:
    """Numbers, from 1, of the prismatic joints of a chain."""
    return frozenset((np.flatnonzero(chain.prismatic) + 1).tolist())


PRIOR_SCALES = (0.03, 3.3)
"""Least and greatest prior scale of an effect: at most three times what makers or published measurements state (sizes
and sources: docs/reference/effects.md). At the least one it is absent: of 3e-4 rad of compliance 0.009 mm are left at
1 m, below any repeatability; a prior of σ 0 would have no logarithm to search.
"""


@final
@dataclass(frozen=True, eq=False)
class EffectInputs:
    """What is known of a robot and its rows before a fit: the inputs of `Effect.of_inputs`.

    chain: nominal, with its taught tool. at: postures and conditions of the rows. tool_mass_kg: 0 where it is not
    known. down: which way weight pulls, in the robot's base frame.
    """

    chain: SerialChain
    at: Postures
    tool_mass_kg: float = 0.0
    down: Direction = DOWN


@final
@dataclass(eq=False)
class OnlineTerms:
    """What the on-line kernel can evaluate in every cycle, for a robot with n joints at one load and temperature.

    at: a single posture with both. down: which way weight pulls, in the base frame. weight (n, 2, n): rad of joint j
    by the weight moment that is fixed along x, y of the frame behind joint k, at [k, axis, j]. load (n,): rad of each
    joint per mm of the load's lever. bend: mm of the TCP of a level tool. stretch (n + 1,): expanded links shift the
    TCP by Σ_k stretch_k p_k, p_k the origin of the frame behind joint k + 1 (the last: the flange). waves: joint from
    0, waves per turn, amounts of sine and cosine, rad. nodes: of Σ_m w_m exp(−½ Σ_j (s_mj q_j − c_mj)²), places c (M,
    n), pure numbers, scales s (M, n), 1/rad, and weights w (M, 3), mm. left_out: what the correction lacks, in words.
    """

    at: Postures
    joints: int
    down: Direction = DOWN
    bend: float = 0.0
    weight: Floats = field(init=False)
    load: Floats = field(init=False)
    stretch: Floats = field(init=False)
    waves: list[tuple[float, float, float, float]] = field(default_factory=list)
    nodes: list[tuple[Floats, Floats, Floats]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        n = self.joints
        self.weight, self.load, self.stretch = np.zeros((n, 2, n)), np.zeros(n), np.zeros(n + 1)


class Effect(ABC):
    """A cause of error with K amounts κ. It turns the joints by Φκ and shifts the TCP by Ψκ.

    Both are worked out on the *nominal* chain in its own base frame (`with_base(identity)`, no deviations): an error of
    a thousandth in where a load pulls is a thousandth of a thousandth at the tool, and so every derivative stays exact
    and closed.

    group: name of the kind, by which it is freed or held, named in `--model`, and stored. title: the same for people.
    chosen: whether a person may name it (`named`), `auto` may try it besides (`tried`), it joins a model where the rows
    show that something is missing (`by evidence`), or `auto` tries it after all others, with settings from what these
    leave (`by held-out rows`); the last two are residual models. of_touches: whether `auto` begins with it
    where the tool touches. needs: what it needs, where rows do not show it. missing: conditions that it needs at a
    prediction, each with what is predicted without it. prior_scales: bounds of what the evidence may scale its prior
    by; None: it is never scaled.
    """

    __slots__ = ()

    group: ClassVar[Group]
    title: ClassVar[str]
    chosen: ClassVar[Literal["named", "tried", "by evidence", "by held-out rows"]] = "tried"
    of_touches: ClassVar[bool] = False
    needs: ClassVar[str] = ""
    missing: ClassVar[tuple[tuple[Condition, str], ...]] = ()
    prior_scales: ClassVar[tuple[float, float] | None] = PRIOR_SCALES

    @classmethod
    @abstractmethod
    def of_inputs(cls, setup: EffectInputs) -> Self | None:
        """The effect for a robot, as far as its rows support it; None where they do not."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Its amounts (K,); their names are unique in a model."""

    @property
    @abstractmethod
    def sigma(self) -> Floats:
        """How large each amount (K,) is expected to be about 0, 1 σ, in its unit."""

    @property
    def least(self) -> Floats:
        """Lower bound of each amount (K,), in its unit: 0 where a negative one has no meaning, else −inf."""
        return np.full(len(self.parameters), -np.inf)

    def lacks(self, at: Postures) -> list[str]:
        """In words: what is predicted at postures `at` without the conditions that were not recorded."""
        return [words for condition, words in self.missing if getattr(at, condition) is None]

    def suits(self, joints: int) -> bool:
        """Whether it is an effect of a robot with so many joints."""
        return bool(getattr(self, "joints", joints) == joints)

    def turns(self, nominal: SerialChain, at: Postures) -> Floats | OwnTurns | None:
        """Φ (N, n, K): rad (m of a prismatic joint) of each joint per unit of each amount; None where it turns none."""
        return None

    def shifts(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """Ψ (N, 3, K): mm of the TCP, in the robot's base frame, per unit; None where nothing shifts."""
        return None

    def fixed_turns(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """Turn of each joint (N, n), rad, that no amount scales; None where there is none."""
        return None

    def fixed_shift(self, nominal: SerialChain, at: Postures) -> Floats | None:
        """Shift of the TCP (N, 3), mm, in the robot's base frame, that no amount scales; None where there is none."""
        return None

    def add_online(self, amounts: Floats, terms: OnlineTerms) -> None:
        """Add its amounts (K,) to the terms of the on-line kernel, or say what that leaves out.

        Raises ValueError if the kernel cannot evaluate it, and a model with it must not be used on-line.
        """
        raise ValueError(f"the model's {self.group} cannot be computed on-line; fit one without it")
