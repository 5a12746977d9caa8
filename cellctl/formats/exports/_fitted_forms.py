"""The chain of a form nearest to a model, compared with the nominal robot, and what the form cannot hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, TypeAlias, final

import numpy as np

from cellctl.calibration import Postures, RobotModel
from cellctl.compensation import with_frames, with_geometry, with_zeros_and_frames
from cellctl.formats.model import ModelFile
from cellctl.formats.table_making import measured_postures, nominal_chain
from cellctl.kinematics import Floats, SerialChain

if TYPE_CHECKING:
    Nearest: TypeAlias = Callable[[SerialChain, RobotModel, Postures], SerialChain]


@final
@dataclass(frozen=True, slots=True)
class Cost:
    """Distance of the exported form's TCP from the model's, mm, over `postures` postures of the measured region."""

    rms_mm: float
    max_mm: float
    postures: int

    @classmethod
    def of(cls, chain: SerialChain, q: Floats, goal: Floats) -> Self:
        """Of a chain's TCP at model angles q (N, n), rad, from that of poses `goal` (N, 4, 4), mm."""
        distances = np.linalg.norm((chain.forward(q) - goal)[:, :3, 3], axis=1)
        return cls(float(np.sqrt(np.mean(distances**2))), float(distances.max()), len(distances))

    @property
    def words(self) -> str:
        """For people."""
        return f"{self.rms_mm:.3f} mm RMS, {self.max_mm:.3f} mm at most, over {self.postures} postures"

    def figures(self) -> dict[str, Any]:
        """For the JSON."""
        return {"rms_mm": self.rms_mm, "max_mm": self.max_mm, "postures": self.postures}


def effects_left_out(model: ModelFile) -> dict[str, bool]:
    """Titles of the effects with amounts other than 0, which a form of geometry alone lacks.

    The value is whether a `Cost` counts it: not where it needs a temperature or currents.
    """
    identified, at = model.robot_model(), measured_postures(model)
    chain, deviations = len(identified.chain.parameters), identified.deviations
    start, found = chain, {}
    for effect in identified.effects:
        end = start + len(effect.parameters)
        if deviations[start:end].any():
            alone = np.zeros(len(deviations))
            alone[:chain], alone[start:end] = deviations[:chain], deviations[start:end]
            moved = identified.with_deviations(alone).tcp(at) - identified.chain.forward(at.q)[:, :3, 3]
            found[effect.title.lower()] = bool(np.abs(moved).max() > 1e-9)
        start = end
    return found


FOLDS = 5


@final
@dataclass(frozen=True, eq=False)
class FittedForm:
    """chain: nearest to the model over its measured postures. cost: its distance from the model there.

    nominal: that of the nominal robot with base and tool registered. held_out, nominal_held_out: RMS distance, mm, at
    postures that were held out of the fit, each fifth of them in turn.
    """

    chain: SerialChain
    cost: Cost
    nominal: Cost
    held_out: float
    nominal_held_out: float

    @property
    def better(self) -> bool:
        """Whether it is nearer to the model than nominal at postures that were held out of the fit."""
        return self.held_out < self.nominal_held_out

    @property
    def warnings(self) -> list[str]:
        """For people: that the form is not worth its use, where it is not."""
        if self.better:
            return []
        figures = f"{self.held_out:.3f} mm RMS against {self.nominal_held_out:.3f} mm"
        cure = "use the nominal robot, or the whole model: `cellctl compensate`"
        return [f"warning: not better than nominal, at postures that were held out of its fit: {figures}; {cure}"]

    def figures(self) -> dict[str, Any]:
        """For the JSON."""
        return {
            "nominal": self.nominal.figures(),
            "held_out_rms_mm": self.held_out,
            "nominal_held_out_rms_mm": self.nominal_held_out,
            "better_than_nominal": self.better,
        }


def fitted_geometry(model: ModelFile) -> FittedForm:
    """Links, base and tool (`cellctl.compensation.with_geometry`)."""
    return _fitted(model, with_geometry)


def fitted_zeros(model: ModelFile) -> FittedForm:
    """Joint zeros, base and tool (`cellctl.compensation.with_zeros_and_frames`)."""
    return _fitted(model, with_zeros_and_frames)


def _fitted(model: ModelFile, nearest: Nearest) -> FittedForm:
    controller, identified, at = nominal_chain(model), model.robot_model(), measured_postures(model)
    goal = identified.pose(at)
    chain, nominal = (fit(controller, identified, at) for fit in (nearest, with_frames))
    elsewhere = [_held_out(controller, identified, at, fit) for fit in (nearest, with_frames)]
    return FittedForm(chain, Cost.of(chain, at.q, goal), Cost.of(nominal, at.q, goal), *elsewhere)


def _held_out(controller: SerialChain, identified: RobotModel, at: Postures, nearest: Nearest) -> float:
    """RMS distance, mm, at each fifth of the postures of the chain nearest at the others."""
    goal, fold, distances = identified.tcp(at), np.arange(len(at)) % FOLDS, np.empty(len(at))
    for part in range(FOLDS):
        held = fold == part
        chain = nearest(controller, identified, at.pick(~held))
        distances[held] = np.linalg.norm(chain.forward(at.q[held])[:, :3, 3] - goal[held], axis=1)
    return float(np.sqrt(np.mean(distances**2)))
