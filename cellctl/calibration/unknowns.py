"""What a fit may change, and how far it is expected to: groups, tolerances, priors."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Literal, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.model import DEFLECTION, RobotModel
from cellctl.kinematics import Bools, Floats

Group: TypeAlias = Literal["base", "geometry", "tool", "deflection", "centres"]
"""Parameters that are freed or held together."""


@final
@dataclass(frozen=True, slots=True)
class Tolerances:
    """What is known before the measurement: 1 σ of each kind of parameter about the nominal value.

    `tool_mm` and `tool_deg` hold for a taught tool. `flat_mm` and `flat_rad` stand for *nothing is known* (base and
    tool in an instrument's frame, sphere centres): so wide that they move no result, finite so that every problem is
    well posed.
    """

    link_mm: float = 0.5
    angle_deg: float = 0.05
    joint_zero_deg: float = 0.05
    tool_mm: float = 2.0
    tool_deg: float = 0.5
    deflection: float = 0.002
    flat_mm: float = 1000.0
    flat_rad: float = 1.0


@final
@dataclass(frozen=True, eq=False)
class State:
    """Where a fit stands: the robot, and the sphere centres (S, 3), mm, in the measuring frame."""

    model: RobotModel
    centres: Floats


@final
@dataclass(frozen=True, eq=False)
class Unknowns:
    """All parameters of a fit in one row: the model's, then the centres' x, y, z.

    names, groups (P); sigma (P,): prior 1 σ, mm, rad or 1/(N·m²); free (P,): may change; start: where each is expected.
    """

    start: State
    names: tuple[str, ...]
    groups: tuple[Group, ...]
    sigma: Floats
    free: Bools

    @classmethod
    def of(
        cls, start: State, spheres: tuple[str, ...], tolerances: Tolerances, *, registered: frozenset[Group]
    ) -> Self:
        """Every parameter of `start`, all free. In groups named `registered`, nothing is known beforehand."""
        model = start.model
        centres = tuple(f"{sphere}_{axis}" for sphere in spheres for axis in "xyz")
        groups: list[Group] = [_group(name) for name in model.parameters] + ["centres" for _ in centres]
        sigma = [
            _sigma(name, bool(turns), group in registered, tolerances)
            for name, turns, group in zip(model.parameters, model.parameter_turns, groups, strict=False)
        ] + [tolerances.flat_mm for _ in centres]
        names = model.parameters + centres
        return cls(start, names, tuple(groups), np.array(sigma), np.ones(len(names), bool))

    def only(self, groups: frozenset[Group]) -> Self:
        """These unknowns with none but `groups` free."""
        return replace(self, free=self.free & np.array([group in groups for group in self.groups]))

    def without(self, names: frozenset[str]) -> Self:
        """These unknowns with `names` held where they start."""
        return replace(self, free=self.free & np.array([name not in names for name in self.names]))

    def restarted(self, start: State) -> Self:
        """The same unknowns, expected at `start`."""
        return replace(self, start=start)

    @property
    def robot(self) -> int:
        """How many of the parameters are the robot's; the rest are centres."""
        return len(self.start.model.parameters)

    def state(self, deviations: Floats) -> State:
        """The state at `deviations` (P,) from the start."""
        model = self.start.model.with_deviations(self.start.model.deviations + deviations[: self.robot])
        return State(model, self.start.centres + deviations[self.robot :].reshape(-1, 3))


def _group(name: str) -> Group:
    if name == DEFLECTION:
        return "deflection"
    if name.startswith("base_"):
        return "base"
    return "tool" if name.startswith("tool_") else "geometry"


def _sigma(name: str, turns: bool, registered: bool, tolerances: Tolerances) -> float:
    if registered:
        return tolerances.flat_rad if turns else tolerances.flat_mm
    if name == DEFLECTION:
        return tolerances.deflection
    if name.startswith("tool_"):
        return float(np.deg2rad(tolerances.tool_deg)) if turns else tolerances.tool_mm
    if re.fullmatch(r"theta\d+", name):
        return float(np.deg2rad(tolerances.joint_zero_deg))
    return float(np.deg2rad(tolerances.angle_deg)) if turns else tolerances.link_mm
