"""Held-out rows as a model predicts them: only parameters that no other row determines are first fitted to them.

A socket that is not in the fit, or a session in which the robot was set up anew, has a place that only the held-out
rows determine. It is fitted to them, for nominal and identified alike; the remaining error is that of the robot's model
among these rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellctl.calibration.folds import postures
from cellctl.calibration.identification.identify import Identification, registered, with_tool_registered
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State, Unknowns
from cellctl.calibration.prediction.predict import predict_rows
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate, estimate
from cellctl.calibration.verdict.judgement import HeldOut
from cellctl.calibration.verdict.reliability import Reliability
from cellctl.kinematics import Bools, Floats

_PLACES = frozenset({"base", "tool", "points", "datums"})


def held_out_rows(task: Task, by: Identification, rows: RowBlocks, reliability: Reliability) -> HeldOut:
    """`rows` as nominal, a prior model and the identified robot predict them. None of them was in the fit `by`."""
    used = task.rows.pick(list(by.used))
    unseen = unseen_by(task, by.identified.unknowns, used, rows)
    nominal, identified = _both_settled(task, by, rows, unseen)
    # fitted to these rows: their prior σ is no uncertainty here; what their fit absorbs is in `hidden` and `taken`
    covariance = np.where(unseen[:, None] | unseen, 0.0, by.identified.covariance)
    noisy = rows.noisier(_noise_of(used, by))
    hidden = _hidden(identified, noisy, unseen)
    taken = _taken(identified, noisy, hidden)
    predicted = [
        predict_rows(
            identified,
            covariance,
            block,
            hidden=own,
            taken=taken,
            extra_sigma=reliability.region.outside(block.q) / np.sqrt(3.0),
            tails=reliability.tails,
        )
        for block, own in zip(noisy.blocks, hidden, strict=True)
        if len(block)
    ]
    before = rows.errors(nominal)
    return HeldOut(
        nominal=before if task.nominal is None else nominal_errors(task, used, rows),
        identified=rows.errors(identified),
        variance=np.concatenate([np.zeros(0), *(each.variance for each in predicted)]),
        p_value=np.concatenate([np.zeros(0), *(each.p_value for each in predicted)]),
        left=np.full(len(rows), _share_left(rows, hidden)),
        prior=None if task.nominal is None else before,
        with_tool=_with_tool(task, by.identified.unknowns, used, rows),
        posture=postures(rows.q),
    )


def nominal_errors(task: Task, used: RowBlocks, rows: RowBlocks) -> Floats:
    """Distances (N,), mm, of `rows` from the robot as in its file, registered on the rows `used`."""
    nominal = task.of_nominal
    return held_out_errors(nominal, registered(nominal, used), used, rows)


def _with_tool(task: Task, unknowns: Unknowns, used: RowBlocks, rows: RowBlocks) -> Floats | None:
    """Distances (N,), mm, of `rows` from the robot as in its file with the tool registered on the rows `used`; None
    where registration has the tool anyway, the fit does not find it, or finds nothing but it.

    Visits of sockets register no tool, as only the sockets' places tie them: a tool that was never taught would count
    as an error of the robot that the model removes.
    """
    sockets = all(block.at_point for block in (*used.blocks, *rows.blocks) if len(block))
    tool, robot = unknowns.among(frozenset({"tool"})), ~unknowns.among(_PLACES)
    if not sockets or not (unknowns.free & tool).any() or not (unknowns.free & robot).any():
        return None
    return held_out_errors(task.of_nominal, with_tool_registered(task, used), used, rows)


def _noise_of(used: RowBlocks, by: Identification) -> Floats:
    """The fit's factors of noise; for blocks without a row among those `used`, the greatest of their kind."""
    result = by.noise.copy()
    for block, _, own in used.parts():
        alike = [by.noise[other] for each, _, other in used.parts() if len(each) and type(each) is type(block)]
        if not len(block) and alike:
            result[own] = np.max(alike, axis=0)
    return result


def held_out_errors(task: Task, found: Estimate, used: RowBlocks, rows: RowBlocks) -> Floats:
    """Distances (N,), mm, of held-out `rows` from the estimate `found` from the rows `used`."""
    return rows.errors(_settled(task, found, rows, unseen_by(task, found.unknowns, used, rows)))


def settled(task: Task, by: Identification, rows: RowBlocks) -> tuple[State, State]:
    """The nominal and the identified robot that judge held-out `rows`: with what only these determine fitted."""
    used = task.rows.pick(list(by.used))
    return _both_settled(task, by, rows, unseen_by(task, by.identified.unknowns, used, rows))


def _both_settled(task: Task, by: Identification, rows: RowBlocks, unseen: Bools) -> tuple[State, State]:
    return _settled(task, by.nominal, rows, unseen), _settled(task, by.identified, rows, unseen)


def unseen_by(task: Task, unknowns: Unknowns, used: RowBlocks, rows: RowBlocks) -> Bools:
    """Which parameters (P,) tie `rows` to the robot and are not determined by the rows `used` in the fit."""
    needed = _touched(unknowns, rows) & task.registration_parameters(unknowns)
    return np.asarray(needed & ~_touched(unknowns, used))


def _touched(unknowns: Unknowns, rows: RowBlocks) -> Bools:
    """Which registration parameters (P,) act on `rows`."""
    result, start = np.zeros(len(unknowns.names), bool), unknowns.start
    for block in rows.blocks:
        if not len(block):
            continue
        if block.of_instrument:
            result[start.columns[block.session]] = True
        for axis in range(3):
            result[start.points_at + 3 * np.unique(block.visited[block.visited >= 0]) + axis] = True
        result[start.datums_at + np.unique(block.zeros[block.zeros >= 0])] = True
    return result


def _settled(task: Task, found: Estimate, rows: RowBlocks, unseen: Bools) -> State:
    """The state of `found` with the `unseen` parameters fitted to `rows`."""
    if not unseen.any():
        return found.state
    begin = _begun(task, found, rows, unseen)
    unknowns = replace(found.unknowns, start=begin, free=unseen, prior=None, pinned=None)
    return estimate(unknowns, rows.blocks).state


def _begun(task: Task, found: Estimate, rows: RowBlocks, unseen: Bools) -> State:
    """Start values of the unseen parameters: as for `task` with only `rows`."""
    state = found.state
    models = [
        _placed_anew(model, new, unseen[columns[: len(model.parameters)]])
        for model, new, columns in zip(state.models, task.placed(rows), state.columns, strict=True)
    ]
    seen = task.fixed_by(models, rows)
    points = np.where(unseen[state.of_points].reshape(-1, 3), seen.points, state.points)
    datums = np.where(unseen[state.datums_at :], seen.datums, state.datums)
    return replace(state, models=tuple(models), points=points, datums=datums)


def _placed_anew(model: RobotModel, new: RobotModel, unseen: Bools) -> RobotModel:
    """`model` with base and tool of `new`, each only if it is unseen: the tool is mostly known from other sessions."""
    chain = model.chain
    groups = {each.group for each, is_new in zip(model.parameters, unseen, strict=True) if is_new}
    if "base" in groups:
        chain = chain.with_base(new.chain.base_now)
    if "tool" in groups:
        chain = chain.with_tool(new.chain.tool_now)
    return replace(model, chain=chain)


def _share_left(rows: RowBlocks, hidden: Sequence[Floats | None]) -> float:
    """The share of the rows' numbers that remains after the fit to them: (n − u)/n, u the rank of what was fitted. It
    is their mean redundancy number, and the same for each row.
    """
    fitted = max((own.shape[-1] for own in hidden if own is not None), default=0)
    return max(1.0 - fitted / max(rows.size, 1), 0.0)


def _taken(state: State, rows: RowBlocks, hidden: Sequence[Floats | None]) -> Floats | None:
    """What the fit to these rows absorbed of each parameter (H, P): their columns along the basis `hidden`."""
    parts = [
        np.einsum("nkh,nkp->hp", own, block.jacobian(state) / block.sigma[..., None])
        for own, block in zip(hidden, rows.blocks, strict=True)
        if own is not None
    ]
    return np.sum(parts, axis=0) if parts else None


def _hidden(state: State, rows: RowBlocks, unseen: Bools) -> Sequence[Floats | None]:
    """For each block an orthonormal basis (N, k, H) of what was fitted to the rows, in their standard deviations."""
    if not unseen.any():
        return [None] * len(rows.blocks)
    columns = [block.jacobian(state)[..., unseen] / block.sigma[..., None] for block in rows.blocks]
    stacked = np.concatenate([part.reshape(part.shape[0] * part.shape[1], part.shape[2]) for part in columns])
    stacked = stacked / np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    flat, sizes, _ = np.linalg.svd(stacked, full_matrices=False)
    flat = flat[:, sizes > 1e-9 * max(float(sizes.max(initial=0.0)), 1e-300)]
    cuts = np.cumsum([part.shape[0] * part.shape[1] for part in columns])[:-1]
    pieces = np.split(flat, cuts)
    return [piece.reshape(*part.shape[:2], flat.shape[1]) for piece, part in zip(pieces, columns, strict=True)]
