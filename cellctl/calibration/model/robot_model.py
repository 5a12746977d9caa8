"""The model of a robot: its chain, and effects that turn its joints or shift its TCP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.calibration.model.effect import Effect, OwnTurns
from cellctl.calibration.model.parameter import Parameter, of_chain
from cellctl.calibration.model.postures import At, Postures
from cellctl.calibration.model.residual_model import ResidualModel
from cellctl.kinematics import Bools, Floats, SerialChain

_EffectPart: TypeAlias = tuple[slice, Effect, Floats | OwnTurns | None, Floats | None]

BLOCK = 2048
"""Postures per computation of the effects: harmonics have hundreds of amounts."""


@final
@dataclass(frozen=True, eq=False)
class RobotModel:
    """A chain with its effects. Immutable; parameters are deviations from the chain as first given, then amounts.

    amounts (K,): of the effects, in their own units; none given: all 0.
    """

    chain: SerialChain
    effects: tuple[Effect, ...] = ()
    amounts: Floats = field(default_factory=lambda: np.zeros(0))

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.chain.n

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The chain's parameters, then the effects'."""
        return of_chain(self.chain) + tuple(each for effect in self.effects for each in effect.parameters)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Name of each parameter (P,), as in files."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def parameter_turns(self) -> Bools:
        """Which parameters (P,) are angles (rad)."""
        return np.array([parameter.turns for parameter in self.parameters])

    @cached_property
    def least(self) -> Floats:
        """Lower bound of each parameter (P,), in its unit; −inf where there is none."""
        of_chain = np.full(len(self.chain.parameters), -np.inf)
        return np.concatenate([of_chain, *(effect.least for effect in self.effects)])

    @cached_property
    def deviations(self) -> Floats:
        """The parameters' values (P,), in their units."""
        chain = self.chain.deviations if self.chain.deviations.size else np.zeros(len(self.chain.parameters))
        return np.concatenate([chain, self._amounts])

    @cached_property
    def residual_models(self) -> tuple[ResidualModel, ...]:
        """Those of its effects that are random functions of the posture."""
        return tuple(effect for effect in self.effects if isinstance(effect, ResidualModel))

    def open_variance(self, at: At) -> Floats:
        """Variance that its residual models leave open at each posture (N,): mm² of the TCP on each axis."""
        return self._variance_of(self.residual_models, at)

    def map_variance(self, at: At) -> Floats:
        """The part of `open_variance` (N,) that its error maps leave; NaN: they state none."""
        return self._variance_of([each for each in self.residual_models if each.is_map], at)

    def _variance_of(self, models: Sequence[ResidualModel], at: At) -> Floats:
        postures = Postures.of(at)
        return np.asarray(sum((each.variance(self.nominal, postures) for each in models), np.zeros(len(postures))))

    def outside(self, at: At) -> Floats:
        """How far each posture (N,) is outside the region of its residual models: 0 to 1, a share of variance."""
        postures = Postures.of(at)
        of_each = [np.zeros(len(postures)), *(each.outside(postures) for each in self.residual_models)]
        return np.asarray(np.max(of_each, axis=0))

    def amount(self, name: str) -> float | None:
        """The value of parameter `name` as it is now; None where this model has no such parameter."""
        return float(self.deviations[self.names.index(name)]) if name in self.names else None

    def on(self, base: ArrayLike, tool: ArrayLike) -> Self:
        """This model with base and tool at poses (4, 4), mm, the zeros of their deviations."""
        return replace(self, chain=self.chain.with_base(base).with_tool(tool))

    def with_effects(self, effects: tuple[Effect, ...]) -> Self:
        """This model with `effects` in place of its own, all amounts 0."""
        return replace(self, effects=effects, amounts=np.zeros(0))

    def with_deviations(self, values: ArrayLike) -> Self:
        """This model with its parameters set to `values` (P,). Raises ValueError for a wrong count."""
        given, of_chain = np.asarray(values, float), len(self.chain.parameters)
        if given.shape != (len(self.parameters),):
            raise ValueError(f"{given.size} values for {len(self.parameters)} parameters")
        return replace(self, chain=self.chain.with_parameters(given[:of_chain]), amounts=given[of_chain:])

    def tcp(self, at: At) -> Floats:
        """TCP (..., 3), mm, in the measuring frame."""
        return np.asarray(self.pose(at)[..., :3, 3])

    def pose(self, at: At) -> Floats:
        """Pose of the TCP (..., 4, 4), mm, in the measuring frame."""
        postures = Postures.of(at)
        if not self.effects:
            return _shaped(self.chain.forward(postures.q), at)
        parts = [self._bent_pose(postures.pick(np.s_[k : k + BLOCK])) for k in range(0, len(postures), BLOCK)]
        return _shaped(np.concatenate(parts) if parts else self.chain.forward(postures.q), at)

    def jacobian(self, at: At) -> Floats:
        """Jacobian of the TCP by the parameters (..., 6, P): position (mm), then rotation (rad), per unit of each."""
        postures = Postures.of(at)
        if not self.effects:
            return _shaped(self.chain.parameter_jacobian(postures.q), at)
        parts = self._effect_parts(postures)
        q = self._turned(postures, parts)
        # ∂/∂κ at the turned joints: exact. Φ and Ψ are of the nominal chain, so they have no derivative by its
        # parameters
        columns, arms = self.chain.parameter_jacobian(q), self.chain.tool_jacobian(q)
        result = np.zeros((len(postures), 6, len(self.parameters)))
        result[..., : columns.shape[-1]] = columns
        for place, _, turned, shifted in parts:
            mine = slice(columns.shape[-1] + place.start, columns.shape[-1] + place.stop)
            if turned is not None:
                result[..., mine] = turned.columns(arms) if isinstance(turned, OwnTurns) else np.matmul(arms, turned)
            if shifted is not None:
                result[:, :3, mine] += np.matmul(self.chain.base_now[:3, :3], shifted)
        # the chain's own columns carry its TCP; a turn ω of the base turns the shift d of the effects too: ω × d
        result[:, :3, self._of_base] += np.cross(
            result[:, 3:, self._of_base], self._shift(postures, parts)[:, :, None], axisa=1, axisb=1, axisc=1
        )
        return _shaped(result, at)

    @cached_property
    def _amounts(self) -> Floats:
        count = sum(len(effect.parameters) for effect in self.effects)
        return self.amounts if self.amounts.size else np.zeros(count)

    @cached_property
    def nominal(self) -> SerialChain:
        """The chain of the table alone, in its own base frame; effects are computed on it."""
        bare = self.chain.with_parameters(np.zeros(len(self.chain.parameters)))
        return bare.with_base(np.eye(4))

    @cached_property
    def _of_base(self) -> Any:
        """Indices of the parameters that turn or move the base: they also move the shifts."""
        return np.flatnonzero([parameter.group == "base" for parameter in self.parameters])

    def _bent_pose(self, at: Postures) -> Floats:
        parts = self._effect_parts(at)
        result = self.chain.forward(self._turned(at, parts)).copy()
        result[..., :3, 3] += self._shift(at, parts)
        return result

    def _effect_parts(self, at: Postures) -> list[_EffectPart]:
        """Each effect's amounts, the effect, its Φ and its Ψ (N, 3, K)."""
        start, found = 0, []
        for effect in self.effects:
            place = slice(start, start := start + len(effect.parameters))
            found.append((place, effect, effect.turns(self.nominal, at), effect.shifts(self.nominal, at)))
        return found

    def _turned(self, at: Postures, parts: list[_EffectPart]) -> Floats:
        q = at.q
        for place, effect, turned, _ in parts:
            amounts = self._amounts[place]
            if turned is not None:
                q = q + (turned.total(amounts, self.n) if isinstance(turned, OwnTurns) else turned @ amounts)
            if (fixed := effect.fixed_turns(self.nominal, at)) is not None:
                q = q + fixed
        return q

    def _shift(self, at: Postures, parts: list[_EffectPart]) -> Floats:
        """The TCP's shift (N, 3), mm, in the measuring frame."""
        total = np.zeros((len(at), 3))
        for place, effect, _, shifted in parts:
            if shifted is not None:
                total = total + shifted @ self._amounts[place]
            if (fixed := effect.fixed_shift(self.nominal, at)) is not None:
                total = total + fixed
        return np.asarray(total @ self.chain.base_now[:3, :3].T)


def _shaped(result: Floats, at: At) -> Floats:
    """`result` (N, …) in the shape of the given angles."""
    if isinstance(at, Postures):
        return result
    return result.reshape(*np.shape(at)[:-1], *result.shape[1:])
