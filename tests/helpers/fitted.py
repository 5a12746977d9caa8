"""The one place where the study of the estimator's honesty meets cellctl: a draw in, what was identified out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from cellctl.calibration import (
    Identification,
    Observability,
    PoseRows,
    PositionRows,
    RobotModel,
    RowBlocks,
    SpacingRows,
    Split,
    Task,
    Tolerances,
    ToolDeflection,
    TouchRows,
    fit,
    identify,
    predict,
)
from cellctl.calibration.verdict.reliability import Reliability
from cellctl.kinematics import Link, SerialChain
from tests.helpers.own_model import Floats
from tests.helpers.own_posterior import Unknown
from tests.helpers.own_rows import OwnPoses, OwnPositions, OwnTouches
from tests.helpers.simulated_setups import Draw

TORCH_M = 0.4103
"""Length of the KR5's torch; with the weight, the horizontal torch's sag comes out as the own arm's."""


@dataclass(frozen=True, eq=False)
class Fitted:
    """What cellctl identified. unknown: the parameters that it is unsure of, and where cellctl counts them from;
    found (F,), covariance (F, F). left_out: rows taken for outliers; growth: of σ; prior_scale: of
    which groups the tolerances grew, and by how much.
    """

    unknown: Unknown
    found: Floats
    covariance: Floats
    left_out: int
    growth: float
    converged: bool
    prior_scale: Mapping[str, float]
    identification: Identification
    task: Task

    @property
    def discrepant(self) -> bool:
        """Whether the rows showed that the model lacks something."""
        return any(name.startswith("discrepancy") for name in self.unknown.names)

    def columns(self, q: Floats) -> Floats:
        """How cellctl's tool centre points at q (N, n), rad, move with the free parameters (N, 3, F), mm per unit."""
        best = self.identification.identified
        whole = np.zeros((len(q), 3, len(best.unknowns.names)))
        whole[:, :, best.state.columns[0]] = best.state.model.jacobian(q)[:, :3]
        return whole[..., np.diag(best.covariance) > 0.0]

    def besides(self, q: Floats) -> Floats:
        """1 σ (N,) on each axis, mm, that cellctl adds to its covariance at q (N, n), rad."""
        return Reliability.of(self.task, self.identification).region.sigma(q) / np.sqrt(3.0)

    def predicted(self, q: Floats) -> tuple[Floats, Floats]:
        """Tool centre points (N, 3) and their 1 σ (N,), mm, as cellctl predicts them."""
        best = self.identification.identified
        robot = len(best.state.model.parameters)
        said = predict(best.state.model, best.covariance[:robot, :robot], q)
        return said.poses[:, :3, 3], said.sigma_mm


def fitted(draw: Draw) -> Fitted:
    """`draw`'s rows through `identify`, with the prior that its truth is from."""
    task = task_of(draw)
    done = identify(task)
    best = done.identified
    free = np.flatnonzero(np.diag(best.covariance) > 0.0)
    model, chain = best.state.model, best.state.model.chain
    start = replace(draw.nominal, base=np.array(chain.base), tool=np.array(chain.tool))
    names = tuple(best.unknowns.names[index] for index in free)
    unknown = Unknown(names, best.unknowns.sigma[free], start, draw.rough_centres)
    values = np.concatenate([model.deviations, (best.state.points - draw.rough_centres).ravel()])
    return Fitted(
        unknown=unknown,
        found=values[free],
        covariance=best.covariance[np.ix_(free, free)],
        left_out=len(done.outliers),
        growth=float(np.max(done.noise)),
        converged=best.converged,
        prior_scale=dict(done.prior_scale),
        identification=done,
        task=task,
    )


def observed(draw: Draw) -> Observability:
    """What a user is told that `draw`'s rows can see, and what not."""
    return fit(task_of(draw), Split(np.arange(len(draw.rows.q)), ())).observability


def task_of(draw: Draw) -> Task:
    """The task that a user would give."""
    nominal, bends = draw.nominal, "tool_deflection" in draw.free
    links = [
        Link(theta, d, a, alpha, beta if number in nominal.hayati else None)
        for number, (theta, d, a, alpha, beta) in enumerate(nominal.table.tolist(), start=1)
    ]
    chain = SerialChain.from_links("mdh-hayati", links, nominal.base, nominal.tool)
    prior = draw.told
    tolerances = Tolerances(
        link_mm=prior.link_mm,
        angle_deg=prior.angle_deg,
        joint_zero_deg=prior.joint_zero_deg,
        tool_mm=prior.tool_mm,
        flat_mm=prior.flat_mm,
        flat_rad=prior.flat_rad,
    )
    bend = ToolDeflection(TORCH_M, nominal.sag_mm * 3.0 / (1000.0 * TORCH_M**3), prior.deflection)
    model = RobotModel(chain, (bend,) if bends else ())
    match draw.rows:
        case OwnTouches() as rows:
            touches = TouchRows(rows.q, rows.sphere, np.full(len(rows.q), rows.reach), _all(rows.sigma_mm, rows.q, 1))
            pairs = OwnTouches.pairs(len(draw.centres))
            spacings = SpacingRows(pairs, rows.spacings, np.full((len(pairs), 1), rows.spacing_sigma_mm))
            names = tuple(f"S{number + 1}" for number in range(len(draw.centres)))
            return Task(model, RowBlocks.of(touches), names, draw.rough_centres, spacings, tolerances=tolerances)
        case OwnPoses() as rows:
            sigma = np.hstack([_all(rows.sigma_mm, rows.q, 3), _all(rows.sigma_rad, rows.q, 3)])
            return Task(model, RowBlocks.of(PoseRows(rows.q, rows.poses, sigma)), tolerances=tolerances)
        case OwnPositions() as rows:
            points = PositionRows(rows.q, rows.xyz, _all(rows.sigma_mm, rows.q, 3))
            return Task(model, RowBlocks.of(points), tolerances=tolerances)
        case _:
            raise TypeError(type(draw.rows))


def _all(sigma: float, q: Floats, count: int) -> Floats:
    return np.full((len(q), count), sigma)
