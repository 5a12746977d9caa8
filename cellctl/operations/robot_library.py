"""What the library states about its robots: a line for each, and the figures that follow from their files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self, final

import numpy as np

from cellctl.files import InputError, Problem
from cellctl.installed import near, shipped
from cellctl.robot_file import Frame, RobotFile, SecondSource, Source, Tool

COLUMNS = ("name", "robot", "joints", "reach, mm", "payload, kg", "checked")


@final
@dataclass(frozen=True)
class LibraryRobot:
    """A robot of the library: its name, its file, and what the file says."""

    name: str
    file: Path
    robot: RobotFile

    @classmethod
    def find(cls, name: str) -> Self:
        """The robot of that name. Raises InputError with the nearest names."""
        files = shipped("robot")
        if name not in files:
            raise InputError(Problem(name, 0, 0, "the library has no robot of this name", near(name)))
        return cls(name, files[name], RobotFile.load(files[name]))

    @property
    def source(self) -> Source:
        """Origin of the numbers; a shipped file has one."""
        assert self.robot.source is not None
        return self.robot.source

    @property
    def checked(self) -> str:
        """State of the source: the agreement with a second one, or `single source`."""
        checked = self.source.checked
        return f"within {max(checked.agreement_mm, 0.001):g} mm" if isinstance(checked, SecondSource) else checked

    @cached_property
    def _reach_mm(self) -> float:
        return reach_mm(self.robot)

    @property
    def cells(self) -> tuple[str, ...]:
        """The line of the list, as `COLUMNS`."""
        payload = "" if self.source.payload is None else f"{self.source.payload:g}"
        return (self.name, self.robot.name, str(self.robot.n), f"{self._reach_mm:.0f}", payload, self.checked)

    def to_json(self) -> dict[str, Any]:
        """All that the list says, and the source."""
        return {
            "name": self.name,
            "robot": self.robot.name,
            "joints": self.robot.n,
            "reach_mm": round(self._reach_mm),
            **self.source.model_dump(),
            "file": str(self.file),
        }


def robots() -> list[LibraryRobot]:
    """All robots of the library, by name."""
    return [LibraryRobot(name, file, RobotFile.load(file)) for name, file in shipped("robot").items()]


def reach_mm(robot: RobotFile) -> float:
    """The flange's greatest distance from axis 1 within the joint limits, mm.

    Found by turning one joint after the other to its best angle on a grid that narrows, from several postures.
    """
    bare = robot.model_copy(update={"base": Frame(), "tool": Tool()})
    chain, joints, limits = bare.chain(), robot.joint_map(), robot.limits()
    reached = np.random.default_rng(0).uniform(limits[:, 0], limits[:, 1], (6, robot.n))
    for share in (1.0, 1.0, 1.0, 0.1, 0.1, 0.01):
        steps = share * np.linspace(-1.0, 1.0, 41)[:, None] * (limits[:, 1] - limits[:, 0])
        for joint in range(1, robot.n):
            # p(t) = o + (u·r) u + cos t (r − (u·r) u) + sin t u × r: the flange, r from the joint's axis u through o
            frames = chain.frames(joints.model(reached))
            axis, origin = frames[:, joint, :3, 2], frames[:, joint, :3, 3]
            arm = frames[:, -1, :3, 3] - origin
            along = np.sum(axis * arm, axis=-1, keepdims=True) * axis
            tried = np.clip(reached[:, joint] + steps[:, joint, None], *limits[joint])
            turn = np.deg2rad(joints.sign[joint] * (tried - reached[:, joint]))[..., None]
            flange = origin + along + np.cos(turn) * (arm - along) + np.sin(turn) * np.cross(axis, arm)
            far = np.hypot(flange[..., 0], flange[..., 1])
            reached[:, joint] = tried[far.argmax(axis=0), np.arange(len(reached))]
    return float(far.max())


def markdown(rows: Sequence[LibraryRobot]) -> str:
    """The table of the reference page: the list, with source, licence and second source."""
    head = (*COLUMNS, "numbers (licence)", "second source")
    lines = [head, tuple("---" for _ in head)]
    for row in rows:
        checked = row.source.checked
        second = checked.against if isinstance(checked, SecondSource) else ""
        lines.append((*row.cells, f"{row.source.numbers} ({row.source.licence})", second))
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
