"""A set-up as it would be under a supposition: the same rows with other readings, joints, links or numbers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self, final

import numpy as np

from cellctl.calibration.estimation.task import Task
from cellctl.calibration.model.postures import Postures
from cellctl.calibration.rows import Measured
from cellctl.calibration.rows.row_blocks import Mixture
from cellctl.kinematics import Floats, JointMap, SerialChain


@final
@dataclass(frozen=True, eq=False)
class Case:
    """What was measured, and what it is taken for.

    task: model and rows. joints: what the robot file says of signs and offsets. readings (M, n): the controller's, deg,
    in the order of the task's rows, whose angles are those of `joints`.
    """

    task: Task
    joints: JointMap
    readings: Floats

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.joints.n

    def with_readings(self, readings: Floats) -> Self:
        """The same measurements at other readings (M, n), deg."""
        return replace(self, readings=readings, task=self._turned(self.joints.model(readings)))

    def with_joints(self, sign: Floats, offset: Floats) -> Self:
        """The same readings of joints with other signs (n,) and offsets (n,), deg."""
        joints = JointMap(sign, offset)
        return replace(self, joints=joints, task=self._turned(joints.model(self.readings)))

    def with_chain(self, chain: SerialChain) -> Self:
        """The same measurements of another nominal robot."""
        return replace(self, task=replace(self.task, model=replace(self.task.model, chain=chain)))

    def with_blocks(self, change: Callable[[Measured], Measured]) -> Self:
        """Each block of rows as `change` makes it; the angles stay."""
        return replace(self, task=replace(self.task, rows=Mixture(tuple(map(change, self.task.rows.blocks)))))

    def pick(self, which: Any) -> Self:
        """The rows at `which`: indices in ascending order, or a mask."""
        return replace(self, task=replace(self.task, rows=self.task.rows.pick(which)), readings=self.readings[which])

    def session(self, number: int) -> tuple[Any, Self]:
        """The rows of one session, as indices (N,) of all, and these alone, as the only session that there is."""
        blocks = [block for block in self.task.rows.blocks if block.session == number]
        rows = np.flatnonzero([block.session == number for block in self.task.rows.blocks for _ in range(len(block))])
        mixture = Mixture(tuple(block.changed(session=0) for block in blocks))
        task = replace(self.task, rows=mixture, sessions=(self.task.sessions[number],))
        return rows, replace(self, task=task, readings=self.readings[rows])

    def thinned(self, count: int) -> Self:
        """At most `count` of the rows, evenly spread over them."""
        if len(self.readings) <= count:
            return self
        return self.pick(np.linspace(0, len(self.readings) - 1, count).astype(int))

    def _turned(self, q: Floats) -> Task:
        blocks, start = [], 0
        for block in self.task.rows.blocks:
            mine = q[start : start + len(block)]
            blocks.append(block.changed(at=replace(Postures.of(block.at), q=mine)))
            start += len(block)
        return replace(self.task, rows=Mixture(tuple(blocks)))
