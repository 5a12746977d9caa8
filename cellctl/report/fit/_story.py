"""The input of a fit report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self, final

import numpy as np

from cellctl.calibration import Estimate, FitResult, Split, Task
from cellctl.formats import Measurements, RobotFile
from cellctl.kinematics import Floats
from cellctl.report._summary import conditions_of


@final
@dataclass(frozen=True, eq=False)
class FitStory:
    """A fit, with its input.

    robot: the nominal robot's file. task: of the identification, with all rows. readings (N, n): controller
    readings of the task's rows, deg. lines (N,): of each row in its file. said: the figures with the sentence,
    and outliers and rejected rows by line, as `cellctl.formats.fit_report` words them. sources: input files, by name.
    numbers: line → number of the touch. conditions: instrument, operator and the like, name and text.
    """

    robot: RobotFile
    task: Task
    result: FitResult
    split: Split
    readings: Floats
    lines: tuple[int, ...]
    said: Mapping[str, Any]
    sources: Mapping[str, str] = field(default_factory=dict)
    numbers: Mapping[int, str] = field(default_factory=dict)
    conditions: Sequence[tuple[str, str]] = ()

    @classmethod
    def of(
        cls,
        measured: Measurements,
        result: FitResult,
        split: Split,
        said: Mapping[str, Any],
        sources: Mapping[str, str] | None = None,
    ) -> Self:
        """From the rows that `cellctl.formats.measurements` made from a data set."""
        data = measured.data
        return cls(
            robot=measured.robot,
            task=measured.task,
            result=result,
            split=split,
            readings=measured.readings,
            lines=measured.lines,
            said=said,
            sources=sources or {},
            numbers=dict(zip(data.lines, data.texts("touch"), strict=True)),
            conditions=conditions_of(data),
        )

    @property
    def found(self) -> Estimate:
        """The identified robot."""
        return self.result.identification.identified

    @cached_property
    def used(self) -> Any:
        """Indices of the rows of the fit."""
        return np.array(self.result.identification.used, int)

    @cached_property
    def held_out(self) -> Any:
        """Indices of the held-out rows. None if each row was held out once (cross-validation)."""
        judging = np.concatenate([np.zeros(0, int), *(np.asarray(test, int) for _, test in self.split.judged)])
        return np.setdiff1d(judging, np.asarray(self.split.fit, int))

    @cached_property
    def limits(self) -> Floats:
        """Model angles (n, 2) that the joints can reach, rad."""
        ends = self.robot.joint_map().model(self.robot.limits().T)
        return np.asarray(np.sort(ends, axis=0).T)

    @property
    def joints(self) -> list[str]:
        """The joints' names; those of prismatic joints with their unit: `A1 (mm)`."""
        units = self.robot.joint_map().units
        return [f"A{number}{' (mm)' if unit == 'mm' else ''}" for number, unit in enumerate(units, 1)]

    @property
    def sessions(self) -> list[str]:
        """The sessions' names, or numbers if they have none."""
        return [session.name or f"session {number}" for number, session in enumerate(self.task.sessions, 1)]
