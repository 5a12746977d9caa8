"""What a fit report is made from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self, final

import numpy as np

from cellctl.calibration import Estimate, FitResult, Split, Task
from cellctl.formats import Measurements, RobotFile
from cellctl.kinematics import Floats
from cellctl.report.conditions import conditions_of


@final
@dataclass(frozen=True, eq=False)
class FitStory:
    """A fit, with what it was made from.

    robot: the nominal robot's file. task: what was to be identified, with all rows. readings (N, n): controller
    readings of the task's rows, deg. lines (N,): where each stood in its file. said: the figures with the sentence,
    and outliers and rejected rows by line, as `cellctl.formats.fit_report` words them. sources: what was read, by name.
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
        """Of the rows that `cellctl.formats.measurements` made of a data set."""
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
        """Indices of the rows that made the fit."""
        return np.array(self.result.identification.used, int)

    @cached_property
    def held_out(self) -> Any:
        """Indices of the rows that judged the fit and were not in it. None where each row judged a fit of others."""
        judging = np.concatenate([np.zeros(0, int), *(np.asarray(test, int) for _, test in self.split.judged)])
        return np.setdiff1d(judging, np.asarray(self.split.fit, int))

    @cached_property
    def limits(self) -> Floats:
        """Model angles (n, 2) that the joints can reach, rad."""
        ends = self.robot.joint_map().model(self.robot.limits().T)
        return np.asarray(np.sort(ends, axis=0).T)

    @property
    def joints(self) -> list[str]:
        """The joints' names."""
        return [f"A{number + 1}" for number in range(self.robot.n)]

    @property
    def sessions(self) -> list[str]:
        """The sessions' names; those without one by number."""
        return [session.name or f"session {number}" for number, session in enumerate(self.task.sessions, 1)]
