"""The same measurements at other postures: what rows would show with other robot motion."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cellctl.calibration.model.postures import Postures
from cellctl.calibration.model.robot_model import RobotModel
from cellctl.calibration.model.unknowns import State, Unknowns
from cellctl.calibration.rows import Measured, Rows
from cellctl.calibration.solver.estimate import linearised
from cellctl.kinematics import Bools, Floats

ROWS = 60
"""Sample size of rows for each block."""

STEPS = 40
"""Maximum on the way back to a fixed point: 0.8 rad in steps of 0.4, and the rest for the last micrometre."""

FURTHEST_RAD = 0.4
"""Largest step of a joint on the way back to a fixed point: beyond it the Jacobian is another one."""

BACK_MM = 1e-3
"""A TCP this near to its point has reached it."""

DAMPING_MM2 = 1.0
"""Damping of the least squares step, mm²: along a direction with less than a mm of lever hardly anything moves."""


def thinned(block: Measured) -> Measured:
    """At most `ROWS` of the rows, evenly spread over them."""
    if len(block) <= ROWS:
        return block
    return block.pick(np.linspace(0, len(block) - 1, ROWS).astype(int))


def moved(block: Measured, state: State, joints: Bools, by_rad: float) -> Measured:
    """The rows with each of `joints` (n,) moved by up to `by_rad`, at random.

    Where a fixed point holds the TCP, the other joints bring it back; rows where they cannot are left out.
    """
    spread = np.random.default_rng(len(block)).uniform(-by_rad, by_rad, block.q.shape)
    q, model = block.q + np.where(joints, spread, 0.0), state.models[block.session]
    if (block.visited < 0).all():
        return _at(block, q, model)
    tcps = block.anywhere(state) if joints.all() else model.tcp(block.postures)
    return brought(block, model, q, tcps, np.ones(len(joints), bool) if joints.all() else ~joints)


def brought(block: Measured, model: RobotModel, q: Floats, tcps: Floats, joints: Bools) -> Measured:
    """The rows with their TCPs moved to `tcps` (N, 3), mm, from angles `q` (N, n) by `joints` (n,) alone; rows that
    do not reach it are left out.
    """
    q = _reaching(block, model, q, tcps, joints)
    return _at(block, q, model).pick(_away(block, model, q, tcps) < BACK_MM)


def in_their_sockets(block: Measured, state: State) -> Measured:
    """Visits to sockets with each TCP exactly in its socket, where the robot can reach it; others unchanged.

    Before identification TCPs scatter about their socket, and this scatter would make the orientation of the robot as a
    whole observable.
    """
    if not block.at_point or not len(block):
        return block
    model, tcps = state.models[block.session], state.points[block.visited]
    q = _reaching(block, model, block.q, tcps, np.ones(block.q.shape[1], bool))
    near = _away(block, model, q, tcps) < BACK_MM
    return _at(block, np.where(near[:, None], q, block.q), model)


def _reaching(block: Measured, model: RobotModel, q: Floats, tcps: Floats, joints: Bools) -> Floats:
    """Angles (N, n) that bring the TCPs to `tcps` (N, 3), as near as `joints` can from `q`."""
    for _ in range(STEPS):
        away = tcps - model.tcp(_with(block, q))
        if np.all(np.abs(away) < 0.1 * BACK_MM):
            break
        arms = model.chain.tool_jacobian(q)[:, :3] * joints
        square = np.matmul(arms, arms.swapaxes(1, 2)) + DAMPING_MM2 * np.eye(3)
        step = np.matmul(arms.swapaxes(1, 2), np.linalg.solve(square, away[..., None]))[..., 0]
        q = q + np.clip(step, -FURTHEST_RAD, FURTHEST_RAD)
    return q


def _away(block: Measured, model: RobotModel, q: Floats, tcps: Floats) -> Floats:
    return np.asarray(np.linalg.norm(tcps - model.tcp(_with(block, q)), axis=1))


def under(block: Measured, **conditions: Any) -> Measured:
    """The rows under other conditions: `approach`, `delta_t`, `payload`, `currents`."""
    return block.changed(at=replace(block.postures, **conditions))


def lines(unknowns: Unknowns, blocks: Any) -> Floats:
    """Derivative of the rows by the free unknowns (K, F) at their start, in the rows' σ per tolerance."""
    free = np.flatnonzero(unknowns.free)
    found = [_lines(unknowns, block, free) for block in blocks if len(block)]
    return np.concatenate([np.zeros((0, free.size)), *found])


def _lines(unknowns: Unknowns, block: Rows, free: Any) -> Floats:
    return linearised(block, unknowns.start, free, unknowns.sigma[free])[0].reshape(-1, free.size)


def _with(block: Measured, q: Floats) -> Postures:
    return replace(block.postures, q=q)


def _at(block: Measured, q: Floats, model: RobotModel) -> Measured:
    """The block at angles `q` (N, n), with the model's poses there."""
    return block.moved_to(_with(block, q), model)
