"""A set-up, hypotheses about its errors, and the corrected set-up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, Self, TypeAlias, final

import numpy as np

from cellctl.calibration.model.postures import Postures
from cellctl.calibration.problem.task import Task
from cellctl.calibration.rows import Measured
from cellctl.calibration.rows.row_blocks import RowBlocks
from cellctl.kinematics import Bools, Floats, JointMap, SerialChain

Source: TypeAlias = Literal["robot", "data", "artefact"]
"""The file that holds the error: the robot file, the data set, or the file with the size of the spheres."""


@final
@dataclass(frozen=True, eq=False)
class Setup:
    """Measurements with their interpretation.

    task: model and rows. joints: signs and offsets of the robot file. readings (M, n): the controller's, deg, in the
    order of the task's rows, whose angles are those of `joints`.
    """

    task: Task
    joints: JointMap
    readings: Floats

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.joints.n

    @property
    def revolute(self) -> Bools:
        """Which joints (n,) are revolute: their readings may be degrees or radians."""
        return np.array([unit == "°" for unit in self.joints.units])

    @property
    def positions(self) -> Floats:
        """Measured positions (M, 3), mm; NaN for rows of other kinds."""
        return np.concatenate(
            [
                np.full((len(block), 3), np.nan) if block.positions is None else block.positions
                for block in self.task.rows.blocks
            ]
        )

    def with_readings(self, readings: Floats) -> Self:
        """The same measurements at other readings (M, n), deg."""
        return replace(self, readings=readings)._with_angles()

    def with_joints(self, sign: Floats, offset: Floats) -> Self:
        """The same readings of joints with other signs (n,) and offsets (n,), deg."""
        return replace(self, joints=replace(self.joints, sign=sign, offset=offset))._with_angles()

    def with_chain(self, chain: SerialChain) -> Self:
        """The same measurements of another nominal robot."""
        return replace(self, task=replace(self.task, model=replace(self.task.model, chain=chain)))

    def with_positions(self, positions: Floats) -> Self:
        """Other measured positions (M, 3), mm; rows of other kinds stay."""
        return self._with_blocks(lambda block, xyz: block.with_positions(xyz), positions)

    def with_blocks(self, change: Callable[[Measured], Measured]) -> Self:
        """Each block of rows changed by `change`; the angles stay."""
        return replace(self, task=replace(self.task, rows=RowBlocks(tuple(map(change, self.task.rows.blocks)))))

    def pick(self, which: Any) -> Self:
        """The rows at `which`: indices in ascending order, or a mask."""
        return replace(self, task=replace(self.task, rows=self.task.rows.pick(which)), readings=self.readings[which])

    def session(self, number: int) -> tuple[Any, Self]:
        """The rows of one session, as indices (N,) of all, and as a set-up with only this session."""
        blocks = [block for block in self.task.rows.blocks if block.session == number]
        rows = np.flatnonzero([block.session == number for block in self.task.rows.blocks for _ in range(len(block))])
        mixture = RowBlocks(tuple(block.changed(session=0) for block in blocks))
        task = replace(self.task, rows=mixture, sessions=(self.task.sessions[number],))
        return rows, replace(self, task=task, readings=self.readings[rows])

    def thinned(self, count: int) -> Self:
        """At most `count` of the rows, evenly spread over them."""
        if len(self.readings) <= count:
            return self
        return self.pick(np.linspace(0, len(self.readings) - 1, count).astype(int))

    def _with_angles(self) -> Self:
        angles = self.joints.model(self.readings)
        return self._with_blocks(lambda block, q: block.changed(at=replace(Postures.of(block.at), q=q)), angles)

    def _with_blocks(self, change: Callable[[Measured, Floats], Measured], values: Floats) -> Self:
        """Each block changed by `change` with its rows of `values` (M, …)."""
        parts = iter(np.split(values, np.cumsum([len(block) for block in self.task.rows.blocks])))
        return self.with_blocks(lambda block: change(block, next(parts)))


@final
@dataclass(frozen=True, slots=True)
class Change:
    """One set-up error and its cure.

    what: `A3 reversed`; `{0}`, `{1}` in it are replaced by `rows`, indices of the task's rows, if not all are affected.
    source, key: the file, and the place in it: a path of keys (`("joints", 2, "sign")`), or columns of a data set.
    cure: what to do there.
    """

    what: str
    source: Source
    cure: str
    key: tuple[str | int, ...] = ()
    rows: tuple[int, ...] = ()

    def words(self, name: Callable[[int], str]) -> str:
        """`what` with each row called by its `name`."""
        return self.what.format(*map(name, self.rows))


@final
@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Changes that are made together, and the set-up with them.

    complexity: of equally good hypotheses, the one with the smaller number comes first. mastering: the changes are only
    small offsets of joint zeros. The identification finds those; they are not set-up errors.
    """

    changes: tuple[Change, ...]
    setup: Setup
    complexity: int = 0
    mastering: bool = False
