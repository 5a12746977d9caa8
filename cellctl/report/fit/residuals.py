"""The residuals of a fit for the nominal and the identified robot: every row used, left out, or held out."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration import Estimate, Measured, RowBlocks, State
from cellctl.calibration.verdict.heldout import held_out_rows, settled, unseen_by
from cellctl.kinematics import Bools, Floats, inverse_pose
from cellctl.records import ResidualsRow
from cellctl.report.fit._story import FitStory

_DIGITS = 9
"""Significant digits of stored numbers."""


@final
@dataclass(frozen=True, eq=False)
class Residuals:
    """N rows as arrays; the columns are those of `cellctl.records.ResidualsRow`, with NaN in place of None."""

    line: Any
    number: Any
    row: Any
    session: Any
    point: Any
    on_sphere: Bools
    held_out: Bools
    outlier: Bools
    readings: Floats
    tip: Floats
    tip_base: Floats
    before: Floats
    after: Floats
    signed_before: Floats
    signed_after: Floats
    normal: Floats
    turn: Floats
    joint_before: Floats
    joint_after: Floats
    scaled: Floats
    p_value: Floats

    @classmethod
    def of_row(cls, row: ResidualsRow) -> Self:
        """From the row that a run stored."""
        kinds = {"str": str, "int": int, "bool": bool}
        columns = {each.name: str(each.type).removeprefix("tuple[").partition(",")[0] for each in fields(row)}
        return cls(**{name: np.array(getattr(row, name), kinds.get(of, float)) for name, of in columns.items()})

    def stored(self) -> ResidualsRow:
        """The row that a run stores."""
        return ResidualsRow(**{name: listed(value) for name, value in vars(self).items()})

    def pick(self, which: Any) -> Self:
        """The rows at a mask or indices."""
        return replace(self, **{name: value[which] for name, value in vars(self).items()})

    def __len__(self) -> int:
        return len(self.row)

    @property
    def distances(self) -> Bools:
        """Which rows (N,) measured only a distance."""
        return np.asarray(np.isfinite(self.signed_after))

    @property
    def fitted(self) -> Bools:
        """Which rows (N,) the fit used."""
        return np.asarray(~self.held_out & ~self.outlier)

    @property
    def sizes(self) -> tuple[Floats, Floats]:
        """Distances (N,) before and after, mm."""
        return np.linalg.norm(self.before, axis=1), np.linalg.norm(self.after, axis=1)


def listed(values: Any) -> Any:
    """An array as nested tuples of JSON's own numbers, rounded; None for NaN."""
    if isinstance(values, np.ndarray):
        return tuple(listed(value) for value in (values if values.ndim > 1 else values.tolist()))
    if isinstance(values, float):
        return float(f"{values:.{_DIGITS}g}") if np.isfinite(values) else None
    return values


LEAST_VARIANCE = 1e-6
"""Least share of σ² of a residual: a row that alone determines a parameter has almost no residual."""


def residuals_of(story: FitStory) -> Residuals:
    """All rows of a fit that were used, left out, or held out; in the order of the task's rows."""
    identification = story.result.identification
    left_out, held_out = np.array(identification.outliers, int), story.held_out
    in_fit = np.sort(np.concatenate([story.used, left_out]))
    parts: list[dict[str, Any]] = []
    for which, judging in ((in_fit, False), (held_out, True)):
        rows = story.task.rows.pick(which)
        states = (identification.nominal.state, identification.identified.state)
        if judging and len(which):
            states = settled(story.task, identification, rows)
        predicted = _Predicted.of(identification.identified, judging, judging and _settles(story, rows))
        blocks = [block for block in rows.noisier(identification.noise).blocks if len(block)]
        parts += [_block(block, states, predicted) for block in blocks]
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    index = np.concatenate([in_fit, held_out])
    point = columns.pop("point")
    on_plane, lines = np.isin(point, list(story.task.planes)), np.array(story.lines)[index]
    result = Residuals(
        line=lines,
        number=np.array([story.numbers.get(int(line), "") for line in lines], str),
        row=index,
        point=np.array([story.task.points[at] if at >= 0 else "" for at in point], str),
        on_sphere=np.isfinite(columns["signed_after"]) & (point >= 0) & ~on_plane,
        held_out=np.isin(index, held_out),
        outlier=np.isin(index, [*left_out, *story.result.unpredicted]) & ~np.isin(index, story.used),
        readings=story.readings[index],
        p_value=np.concatenate([np.full(len(in_fit), np.nan), _p_values(story, held_out)]),
        **columns,
    )
    return result.pick(np.argsort(index, kind="stable"))


def _settles(story: FitStory, rows: RowBlocks) -> bool:
    """Whether a parameter of held-out `rows` is determined by these rows alone: then there is no prediction of them."""
    used = story.task.rows.pick(story.used)
    return bool(unseen_by(story.task, story.found.unknowns, used, rows).any())


@final
@dataclass(frozen=True, eq=False)
class _Predicted:
    """The predicted size of residuals: covariance (P, P) of the parameters; own: the free parameters'
    part of it, without the variance that held ones add. judging: for rows that the fit did not use.
    """

    covariance: Floats
    own: Floats
    judging: bool

    @classmethod
    def of(cls, found: Estimate, judging: bool, settles: bool) -> Self | None:
        """Of a fit; None if the held-out rows themselves determined a parameter: then there is no prediction."""
        if settles:
            return None
        covariance, free = found.covariance, found.unknowns.free
        doubted = ~free & (np.diag(covariance) > 0.0)
        through, doubt = covariance[np.ix_(free, doubted)], covariance[np.ix_(doubted, doubted)]
        own = np.zeros_like(covariance)
        own[np.ix_(free, free)] = covariance[np.ix_(free, free)] - through @ np.linalg.pinv(doubt) @ through.T
        return cls(covariance, own, judging)

    def variance(self, columns: Floats, noise: Floats) -> Floats:
        """Of residuals (N, k) with Jacobian (N, k, P) and variances `noise` (N, k) of the measurement.

        σ² + JCJᵀ, less twice the model's adaptation to the rows of its fit: σ² − JCJᵀ without extra variance.
        """
        unsure = np.sum((columns @ self.covariance) * columns, axis=-1)
        if self.judging:
            return np.asarray(noise + unsure)
        bent = np.sum((columns @ self.own) * columns, axis=-1)
        return np.asarray(np.maximum(noise + unsure - 2.0 * bent, LEAST_VARIANCE * noise))


def _block(block: Measured, states: tuple[State, State], predicted: _Predicted | None) -> dict[str, Any]:
    """The columns of one block of rows with its estimated σ."""
    model = states[1].models[block.session]
    tips = model.tcp(block.postures)
    vectors = [_vectors(block, state) for state in states]
    ways = model.chain.tool_jacobian(block.q)[:, :3]
    ways = ways / np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1.0)
    none = np.full((len(block), 3), np.nan)
    return {
        "session": np.full(len(block), block.session),
        "point": block.visited,
        "tip": tips,
        "tip_base": tips @ (back := inverse_pose(model.chain.base_now))[:3, :3].T + back[:3, 3],
        "before": vectors[0],
        "after": vectors[1],
        "signed_before": block.residual(states[0])[:, 0] if block.along_line else none[:, 0],
        "signed_after": block.residual(states[1])[:, 0] if block.along_line else none[:, 0],
        "normal": block.normals(states[1]),
        "turn": block.deviation(states[1])[:, 3:] if block.orientations is not None else none,
        "joint_before": np.einsum("nr,nrj->nj", vectors[0], ways),
        "joint_after": np.einsum("nr,nrj->nj", vectors[1], ways),
        "scaled": _scaled(block, states[1], predicted),
    }


def _vectors(block: Measured, state: State) -> Floats:
    residual = block.deviation(state)
    return residual * block.normals(state) if block.along_line else residual[:, :3]


def _scaled(block: Measured, state: State, predicted: _Predicted | None) -> Floats:
    """Residuals (N, 6) in their predicted standard deviations; NaN if a row has fewer, or without a prediction."""
    result = np.full((len(block), 6), np.nan)
    if predicted is not None:
        maps = state.model.map_variance(block.postures)[:, None] * block.of_length  # their errors are no noise of rows
        variance = predicted.variance(block.jacobian(state), block.sigma**2 + maps)
        result[:, : block.sigma.shape[1]] = block.residual(state) / np.sqrt(variance)
    return result


def _p_values(story: FitStory, held_out: Any) -> Floats:
    if not len(held_out):
        return np.zeros(0)
    rows: RowBlocks = story.task.rows.pick(held_out)
    return held_out_rows(story.task, story.result.identification, rows, story.result.reliability).p_value
