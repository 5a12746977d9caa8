"""What a robot does, as a model: its chain, and the tool's bending under its own weight."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.kinematics import Bools, Floats, SerialChain

DEFLECTION = "tool_deflection"
"""Name of the tool's bending parameter c_t, 1/(N·m²)."""

STANDARD_GRAVITY = 9.80665


@final
@dataclass(frozen=True)
class ToolDeflection:
    """The tool as a cantilever along the flange's z with its weight at the end.

    length_m: from the flange to the tool centre point, along z (of the taught tool: an error in it is taken up by c_t).
    load_n: weight at the end, N. c_t: 1/(E·I), 1/(N·m²). The robot stands upright: gravity is −z of its base frame.
    Tip shift c_t · l³/3 · G · (ĝ − (ĝ·z)z), after Wang et al. 2024 (doi 10.3390/app14219824), eq. 11–20. The tilt at
    the end is part of that shift already, and is not added to it again as their eq. 21 would.
    """

    length_m: float
    load_n: float
    c_t: float = 0.0

    @property
    def mm_per_unit(self) -> float:
        """Shift of a horizontal tool's tip for c_t = 1, mm."""
        return 1000.0 * self.length_m**3 / 3.0 * self.load_n


@final
@dataclass(frozen=True, eq=False)
class RobotModel:
    """A chain with a tool that may bend. Immutable; parameters are deviations from the chain as first given."""

    chain: SerialChain
    deflection: ToolDeflection | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.chain.n

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """The chain's parameters, then `tool_deflection` where the tool bends."""
        return self.chain.parameters + ((DEFLECTION,) if self.deflection else ())

    @cached_property
    def parameter_turns(self) -> Bools:
        """Which parameters (P,) are angles (rad)."""
        return np.append(self.chain.parameter_turns, [False] if self.deflection else [])

    @cached_property
    def deviations(self) -> Floats:
        """The parameters' values (P,): mm, rad, 1/(N·m²)."""
        chain = self.chain.deviations if self.chain.deviations.size else np.zeros(len(self.chain.parameters))
        return np.append(chain, [self.deflection.c_t] if self.deflection else [])

    def on(self, base: ArrayLike, tool: ArrayLike) -> Self:
        """This model with base and tool at poses (4, 4), mm, from which their deviations count."""
        return replace(self, chain=self.chain.with_base(base).with_tool(tool))

    def with_deviations(self, values: ArrayLike) -> Self:
        """This model with its parameters set to `values` (P,). Raises ValueError for a wrong count."""
        given = np.asarray(values, float)
        if given.shape != (len(self.parameters),):
            raise ValueError(f"{given.size} values for {len(self.parameters)} parameters")
        if self.deflection is None:
            return replace(self, chain=self.chain.with_parameters(given))
        bent = replace(self.deflection, c_t=float(given[-1]))
        return replace(self, chain=self.chain.with_parameters(given[:-1]), deflection=bent)

    def tip(self, q: ArrayLike) -> Floats:
        """Tool centre point (..., 3), mm, in the measuring frame, at model angles q (..., n), rad."""
        place = self.chain.forward(q)[..., :3, 3]
        return place if self.deflection is None else place + self._shift(q)

    def pose(self, q: ArrayLike) -> Floats:
        """Pose of the tool centre point (..., 4, 4), mm; bending shifts it, its tilt (arc minutes) is left out."""
        result = self.chain.forward(q)
        if self.deflection is None:
            return result
        result = result.copy()
        result[..., :3, 3] += self._shift(q)
        return result

    def jacobian(self, q: ArrayLike) -> Floats:
        """How the tool moves with the parameters (..., 6, P): position (mm), then rotation (rad), per unit of each."""
        columns = self.chain.parameter_jacobian(q)
        if self.deflection is None:
            return columns
        result = np.zeros((*columns.shape[:-1], columns.shape[-1] + 1))
        result[..., :-1] = columns
        result[..., :3, :-1] += self._shift_columns(q, columns[..., 3:, :])
        result[..., :3, -1] = self._shift_per_unit(q)
        return result

    def _gravity(self) -> Floats:
        """Direction of gravity (3,) in the measuring frame."""
        return np.asarray(-self.chain.base_now[:3, 2])

    def _shift(self, q: ArrayLike) -> Floats:
        assert self.deflection is not None
        return np.asarray(self.deflection.c_t * self._shift_per_unit(q))

    def _shift_per_unit(self, q: ArrayLike) -> Floats:
        assert self.deflection is not None
        axis, gravity = self.chain.forward_flange(q)[..., :3, 2], self._gravity()
        return np.asarray(self.deflection.mm_per_unit * (gravity - (axis @ gravity)[..., None] * axis))

    def _shift_columns(self, q: ArrayLike, turns: Floats) -> Floats:
        """How the shift moves with the chain's parameters (..., 3, P), from their turns (..., 3, P).

        A parameter of the links turns z alone; one of the base turns gravity too, as it is fixed to the base; one of
        the tool turns neither, as z is the flange's.
        """
        assert self.deflection is not None
        axis, gravity = self.chain.forward_flange(q)[..., :3, 2], self._gravity()
        of_base = np.array([name.startswith("base_") for name in self.chain.parameters])
        of_tool = np.array([name.startswith("tool_") for name in self.chain.parameters])
        about = np.swapaxes(np.where(of_tool, 0.0, turns), -1, -2)
        axis, along = axis[..., None, :], (axis @ gravity)[..., None, None]
        axis_rate = np.cross(about, axis)
        gravity_rate = np.where(of_base[:, None], np.cross(about, gravity), 0.0)
        along_rate = np.sum(axis_rate * gravity + axis * gravity_rate, axis=-1, keepdims=True)
        rate = gravity_rate - along_rate * axis - along * axis_rate
        return np.asarray(np.swapaxes(self.deflection.c_t * self.deflection.mm_per_unit * rate, -1, -2))
