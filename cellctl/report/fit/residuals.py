"""Every row as the nominal and the identified robot see it: the numbers that the residual pictures draw."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration import Estimate, Measured, RowBlocks, State
from cellctl.calibration.verdict.heldout import held_out_rows, settled, unseen_by
from cellctl.kinematics import Bools, Floats, inverse_pose
from cellctl.report.fit.story import FitStory

LEAST_VARIANCE = 1e-6
"""A row that decides alone about something has no residual to speak of; its share of σ² is taken as this at least."""


@final
@dataclass(frozen=True, eq=False)
class Residuals:
    """N rows: those of the fit, those left out of it, and those held out; in the order of the task's rows.

    index (N,): into the task's rows. held_out (N,). outlying (N,): left out of the fit, or held out and outlying: not
    drawn, as they would set every scale. session (N,), point (N,): numbers; point −1 where none.
    tips (N, 3): tool centre points by the identified robot, mm, in the measuring frame; at_base: the same in the
    robot's base frame. before, after (N, 3): model less measurement in the measuring frame, mm; of a distance, along
    the line to the tip. signed (2, N), normals (N, 3): of distances, before and after, and those lines; NaN of others.
    turned (N, 3): after, of the orientation, rad; NaN where it was not measured. joined (2, N, n): before and after,
    the part along the way that each joint moves the tool, mm. scaled (N, 6): each number after, in the standard
    deviation foreseen of it; NaN where a row has fewer, or it was not foreseen. chance (N,): of a held-out row to lie
    so far from where it was foreseen, or further; NaN of others.
    """

    index: Any
    held_out: Bools
    outlying: Bools
    session: Any
    point: Any
    tips: Floats
    at_base: Floats
    before: Floats
    after: Floats
    signed: Floats
    normals: Floats
    turned: Floats
    joined: Floats
    scaled: Floats
    p_value: Floats

    @classmethod
    def of(cls, story: FitStory) -> Self:
        """All rows of a fit that it used, left out, or was judged by."""
        identification = story.result.identification
        left_out, held_out = np.array(identification.outliers, int), story.held_out
        in_fit = np.sort(np.concatenate([story.used, left_out]))
        parts: list[dict[str, Any]] = []
        for which, judging in ((in_fit, False), (held_out, True)):
            rows = story.task.rows.pick(which)
            states = (identification.nominal.state, identification.identified.state)
            if judging and len(which):
                states = settled(story.task, identification, rows)
            sure = _Sure.of(identification.identified, judging, judging and _settles(story, rows))
            blocks = [block for block in rows.noisier(identification.noise).blocks if len(block)]
            parts += [_block(block, states, sure) for block in blocks]
        columns = {name: np.concatenate([part[name] for part in parts], axis=_axis(name)) for name in parts[0]}
        index = np.concatenate([in_fit, held_out])
        judged = np.isin(index, held_out)
        p_value = np.concatenate([np.full(len(in_fit), np.nan), _chances(story, held_out)])
        outlying = np.isin(index, [*left_out, *story.result.unpredicted]) & ~np.isin(index, story.used)
        result = cls(index=index, held_out=judged, outlying=outlying, p_value=p_value, **columns)
        return result.pick(np.argsort(index, kind="stable"))

    def pick(self, which: Any) -> Self:
        """The rows at a mask or indices."""
        picked = {name: value[:, which] if _axis(name) else value[which] for name, value in vars(self).items()}
        return replace(self, **picked)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def distances(self) -> Bools:
        """Which rows (N,) measured nothing but a distance."""
        return np.asarray(np.isfinite(self.signed[1]))

    @property
    def fitted(self) -> Bools:
        """Which rows (N,) made the fit."""
        return np.asarray(~self.held_out & ~self.outlying)

    @property
    def sizes(self) -> tuple[Floats, Floats]:
        """Distances (N,) before and after, mm."""
        return np.linalg.norm(self.before, axis=1), np.linalg.norm(self.after, axis=1)


def _axis(name: str) -> int:
    return 1 if name in ("signed", "joined") else 0


def _settles(story: FitStory, rows: RowBlocks) -> bool:
    """Whether something about held-out `rows` had to be found from themselves: their numbers were then not foreseen."""
    used = story.task.rows.pick(story.used)
    return bool(unseen_by(story.task, story.found.unknowns, used, rows).any())


@final
@dataclass(frozen=True, eq=False)
class _Sure:
    """What is foreseen of residuals: covariance (P, P) of the parameters; own: that part of it which the free ones have
    without what held ones are in doubt by. judging: of rows that the fit never saw.
    """

    covariance: Floats
    own: Floats
    judging: bool

    @classmethod
    def of(cls, found: Estimate, judging: bool, settles: bool) -> Self | None:
        """Of a fit; None where the rows that judge it had to settle something themselves: nothing was foreseen."""
        if settles:
            return None
        covariance, free = found.covariance, found.unknowns.free
        considered = ~free & (np.diag(covariance) > 0.0)
        through, doubt = covariance[np.ix_(free, considered)], covariance[np.ix_(considered, considered)]
        own = np.zeros_like(covariance)
        own[np.ix_(free, free)] = covariance[np.ix_(free, free)] - through @ np.linalg.pinv(doubt) @ through.T
        return cls(covariance, own, judging)

    def variance(self, columns: Floats, noise: Floats) -> Floats:
        """Of residuals (N, k) with Jacobian (N, k, P) and variances `noise` (N, k) of the measurement.

        σ² + JCJᵀ, less twice what the model bent towards rows that it was made from: σ² − JCJᵀ where none is in doubt.
        """
        unsure = np.sum((columns @ self.covariance) * columns, axis=-1)
        if self.judging:
            return np.asarray(noise + unsure)
        bent = np.sum((columns @ self.own) * columns, axis=-1)
        return np.asarray(np.maximum(noise + unsure - 2.0 * bent, LEAST_VARIANCE * noise))


def _block(block: Measured, states: tuple[State, State], sure: _Sure | None) -> dict[str, Any]:
    """The columns of one block of rows, whose σ are those found."""
    model = states[1].models[block.session]
    tips = model.tcp(block.postures)
    vectors = [_vectors(block, state) for state in states]
    ways = model.chain.tool_jacobian(block.q)[:, :3]
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1.0)
    none = np.full((len(block), 3), np.nan)
    return {
        "session": np.full(len(block), block.session),
        "point": block.visited,
        "tips": tips,
        "at_base": tips @ (back := inverse_pose(model.chain.base_now))[:3, :3].T + back[:3, 3],
        "before": vectors[0],
        "after": vectors[1],
        "signed": np.stack([block.residual(state)[:, 0] if block.along_line else none[:, 0] for state in states]),
        "normals": block.normals(states[1]),
        "turned": block.residual(states[1])[:, 3:] if block.orientations is not None else none,
        "joined": np.stack([np.einsum("nr,nrj->nj", vector, ways) for vector in vectors]),
        "scaled": _scaled(block, states[1], sure),
    }


def _vectors(block: Measured, state: State) -> Floats:
    residual = block.residual(state)
    return residual * block.normals(state) if block.along_line else residual[:, :3]


def _scaled(block: Measured, state: State, sure: _Sure | None) -> Floats:
    """Residuals (N, 6) in their foreseen standard deviations; NaN where a row has fewer, or nothing was foreseen."""
    result = np.full((len(block), 6), np.nan)
    if sure is not None:
        variance = sure.variance(block.jacobian(state), block.sigma**2)
        result[:, : block.sigma.shape[1]] = block.residual(state) / np.sqrt(variance)
    return result


def _chances(story: FitStory, held_out: Any) -> Floats:
    if not len(held_out):
        return np.zeros(0)
    rows: RowBlocks = story.task.rows.pick(held_out)
    return held_out_rows(story.task, story.result.identification, rows, story.result.reliability).p_value
