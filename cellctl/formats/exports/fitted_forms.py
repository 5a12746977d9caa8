"""The chain of a form nearest to a model, effects included, compared with the nominal robot."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias, final

from cellctl.formats.exports.left_out import Cost
from cellctl.formats.measured_postures import measured_postures
from cellctl.formats.table_making import nominal_chain

if TYPE_CHECKING:
    from cellctl.calibration import Postures, RobotModel
    from cellctl.formats.model import ModelFile
    from cellctl.kinematics import SerialChain

    Nearest: TypeAlias = Callable[[SerialChain, RobotModel, Postures], SerialChain]

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
    from cellctl.compensation import with_geometry

    return _fitted(model, with_geometry)


def fitted_zeros(model: ModelFile) -> FittedForm:
    """Joint zeros, base and tool (`cellctl.compensation.with_zeros_and_frames`)."""
    from cellctl.compensation import with_zeros_and_frames

    return _fitted(model, with_zeros_and_frames)


def _fitted(model: ModelFile, nearest: Nearest) -> FittedForm:
    from cellctl.compensation import with_frames

    controller, identified, at = nominal_chain(model), model.robot_model(), measured_postures(model)
    goal = identified.pose(at)
    chain, nominal = (fit(controller, identified, at) for fit in (nearest, with_frames))
    elsewhere = [_held_out(controller, identified, at, fit) for fit in (nearest, with_frames)]
    return FittedForm(chain, Cost.of(chain, at.q, goal), Cost.of(nominal, at.q, goal), *elsewhere)


def _held_out(controller: SerialChain, identified: RobotModel, at: Postures, nearest: Nearest) -> float:
    """RMS distance, mm, at each fifth of the postures of the chain nearest at the others."""
    import numpy as np

    goal, fold, distances = identified.tcp(at), np.arange(len(at)) % FOLDS, np.empty(len(at))
    for part in range(FOLDS):
        held = fold == part
        chain = nearest(controller, identified, at.pick(~held))
        distances[held] = np.linalg.norm(chain.forward(at.q[held])[:, :3, 3] - goal[held], axis=1)
    return float(np.sqrt(np.mean(distances**2)))
