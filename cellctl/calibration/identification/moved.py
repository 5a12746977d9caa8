"""What has changed since a prior model was made: robot, instrument or tool set up anew, and joint zeros.

A zero's change is more precise than the zero: the prior model's error (a turn of the base may be confused with one
of joint 1) is in both, and cancels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np

from cellctl.calibration.identification.identify import registered
from cellctl.calibration.model.parameter import Group
from cellctl.calibration.model.unknowns import State
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.calibration.solver.estimate import Estimate
from cellctl.kinematics import Floats

MOVED = 4.0
"""A prior model whose RMS error falls by this factor when it is registered has been set up anew: a base that drifted by
as much as the model's own errors makes these 1.4 times as large."""

ALIKE = 1.5
"""A frame alone explains the rows if it leaves at most this times what base and tool together leave: these have three
to six parameters more, which lower the RMS of a few rows by a third."""


@final
@dataclass(frozen=True, slots=True)
class Placing:
    """RMS distance of a prior model, 3-D, mm, from what an instrument measured: as it is, and registered anew as the
    task allows; with the base alone, with the tool alone, and with both registered. base_mm, base_deg: how far the
    registered base is from the prior model's, if it alone is registered.
    """

    as_is_mm: float
    registered_mm: float
    with_base_mm: float
    with_tool_mm: float
    with_both_mm: float
    base_mm: float
    base_deg: float

    @property
    def moved(self) -> bool:
        """Whether base or tool have moved since the prior model."""
        return self.as_is_mm >= MOVED * self.registered_mm and self.as_is_mm > 0.0

    @property
    def changed(self) -> Literal["base", "tool", "base and tool"]:
        """What explains the rows, if they moved: the instrument's set-up (`base`), the tool, or only both."""
        if self.with_base_mm <= ALIKE * self.with_both_mm:
            return "base"
        return "tool" if self.with_tool_mm <= ALIKE * self.with_both_mm else "base and tool"

    @property
    def tool_too(self) -> bool:
        """Whether the tool changed as well as the base: base alone leaves far more than both."""
        return self.with_base_mm >= MOVED * self.with_both_mm


def placing(task: Task, nominal: State, rows: RowBlocks) -> Placing | None:
    """How far `task.model`, registered as `nominal`, is from the positions and poses of the first session in `rows`;
    None without such rows.

    Further sessions may have their own base and tool, which are not in a prior model.
    """
    from scipy.spatial.transform import Rotation  # at first use: it takes 0.2 s

    measured = [block for block in rows.blocks if block.of_instrument and block.session == 0 and len(block)]
    if task.prior is None or not measured:
        return None
    seen = RowBlocks.of(tuple(measured))
    first = replace(task, rows=seen, sessions=task.sessions[:1])

    def left(state: State) -> float:
        return float(np.sqrt(np.mean(seen.errors(state) ** 2)))

    def with_anew(*frames: Group) -> State:
        return registered(replace(first, groups=frozenset(frames)), seen).state

    based = with_anew("base")
    by = np.linalg.inv(task.model.chain.base_now) @ based.model.chain.base_now
    return Placing(
        as_is_mm=left(State.alone(task.model)),
        registered_mm=left(nominal),
        with_base_mm=left(based),
        with_tool_mm=left(with_anew("tool")),
        with_both_mm=left(with_anew("base", "tool")),
        base_mm=float(np.linalg.norm(by[:3, 3])),
        base_deg=float(np.rad2deg(Rotation.from_matrix(by[:3, :3]).magnitude())),
    )


def zero_changes(task: Task, found: Estimate) -> tuple[Floats, Floats]:
    """Change of each joint's zero (n,) from `task.model` to `found`, and its 1 σ (n,), rad; mm of a
    prismatic joint.

    With the errors e of the prior model the new zeros are wrong by A e_held + noise, their change by A e_held −
    e_zeros + noise; Σ_new holds A Σ_held Aᵀ + noise, and A Σ_held beside it.
    """
    parameters = found.state.model.parameters
    zeros = np.flatnonzero([parameter.group == "zeros" for parameter in parameters])
    change = found.state.model.deviations[zeros] - task.model.deviations[zeros]
    covariance = found.covariance[np.ix_(zeros, zeros)]
    if task.prior is not None:
        held = np.flatnonzero(~found.unknowns.free[: len(parameters)] & (np.diag(task.prior) > 0.0))
        beside = found.covariance[np.ix_(zeros, held)]
        shared = beside @ _inverse(task.prior[np.ix_(held, held)]) @ task.prior[np.ix_(held, zeros)]
        covariance = covariance + task.prior[np.ix_(zeros, zeros)] - shared - shared.T
    return change, np.sqrt(np.maximum(np.diag(covariance), 0.0))


def _inverse(covariance: Floats) -> Floats:
    """Inverse (H, H) of a covariance in mixed units; combinations known exactly have none, and get weight 0."""
    scales = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    return np.asarray(np.linalg.pinv(covariance / scales, rcond=1e-12, hermitian=True) / scales)
