"""Registers the robot's base frame and the reflectors from poses that are not judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, final

import numpy as np

from cellctl.calibration.estimation.registration import base_and_tool, rigid_fit
from cellctl.files import InputError
from cellctl.formats import ModelFile, RobotFile
from cellctl.formats.table_making import nominal_chain
from cellctl.kinematics import Floats, abc_from_rotation, inverse_pose, pose
from cellctl.procedure import StepContext
from procedures.steps.iso9283.rows import IsoPoseRow, RegistrationRow
from procedures.steps.tracker.rows import MODEL_FILE, PoseRow, ReadModelRow, StationRow
from procedures.steps.tracker.sessions import Sessions
from procedures.steps.tracker.station import reflector_called, session_now

_LEAST = 8
"""Poses from which base and reflector are determined."""


@final
@dataclass(frozen=True, eq=False)
class Arm:
    """A robot by which poses are registered. Frames: nominal robot's base; nominal flange, or the model's tool.

    A model's commands are where its registered nominal robot would be.
    """

    robot: RobotFile
    model: ModelFile | None

    @classmethod
    def of(cls, context: StepContext, *, nominal: bool = False) -> Arm:
        """The identified robot if a model was read, else the nominal one."""
        has_model = bool(context.recorded(ReadModelRow)) and not nominal
        model = ModelFile.load(context.artefact(MODEL_FILE)) if has_model else None
        return cls(RobotFile.load(context.robot_file), model)

    @property
    def name(self) -> Literal["nominal", "identified"]:
        """Which."""
        return "nominal" if self.model is None else "identified"

    def poses(self, readings: Floats) -> Floats:
        """Predicted poses (N, 4, 4), mm, at readings (N, n), deg."""
        if self.model is None:
            return self.commands(readings)
        q = self.model.robot.joint_map().model(readings)
        return np.asarray(self._to_base @ self.model.robot_model().pose(q))

    def commands(self, readings: Floats) -> Floats:
        """Commanded poses (N, 4, 4), mm: of the nominal robot."""
        if self.model is None:
            return self.robot.chain().forward_flange(self.robot.joint_map().model(readings))
        return np.asarray(
            self._to_base @ nominal_chain(self.model).forward(self.model.robot.joint_map().model(readings))
        )

    @property
    def _to_base(self) -> Floats:
        assert self.model is not None
        return inverse_pose(np.array(self.model.start["base"]))


@final
@dataclass(frozen=True, eq=False)
class Registration:
    """base (4, 4): robot's base in the instrument's frame of the first session. reflectors (K, 3): in the arm's frame.

    residual: RMS, 3-D, mm, over `count` poses.
    """

    arm: Arm
    base: Floats
    reflectors: Floats
    residual: float
    count: int

    @classmethod
    def of(cls, context: StepContext, arm: Arm) -> Registration:
        """From the registration poses. Raises InputError if too few have a session."""
        sessions = Sessions.of(context)
        rows = [row for row in context.recorded(PoseRow) if sessions.session(row.visit)]
        if len(rows) < _LEAST:
            what = f"{len(rows)} registration poses were measured with the station still, and {_LEAST} are needed"
            raise InputError(context.cell.problem(("station",), what, "stand the instrument firmly, then begin anew"))
        poses = arm.poses(np.array([row.joints for row in rows]))
        seen = np.array([places(sessions, row) for row in rows])
        rough = reflector_called(context, rows[0].reflector).xyz if arm.model is None else (0.0, 0.0, 0.0)
        base, tool = base_and_tool(poses, seen[:, 0], pose(np.eye(3), np.array(rough)))
        back = np.linalg.inv(base @ poses)
        own = np.einsum("nij,nkj->nki", back[:, :3, :3], seen) + back[:, None, :3, 3]
        reflectors = own.mean(axis=0)
        reflectors[0] = tool[:3, 3]
        residual = float(np.sqrt(((own - reflectors) ** 2).sum(axis=-1).mean()))
        return cls(arm, base, reflectors, residual, len(rows))

    def row(self) -> RegistrationRow:
        """For the journal."""
        return RegistrationRow(
            by=self.arm.name,
            poses=self.count,
            residual=self.residual,
            base=tuple(map(tuple, self.base.tolist())),
            reflectors=tuple(map(tuple, self.reflectors.tolist())),
        )

    def commanded(self, readings: Floats) -> Floats:
        """Place of the first reflector and A, B, C (N, 6), base frame, mm and deg, at commanded readings (N, n)."""
        poses = self.arm.commands(readings)
        place = poses[:, :3, :3] @ self.reflectors[0] + poses[:, :3, 3]
        return np.hstack([place, abc_from_rotation(poses[:, :3, :3])])

    def attained(self, seen: Floats) -> Floats:
        """The same (6,) from the reflectors' measured places (K, 3); the angles are 0 if K < 3."""
        to_base = inverse_pose(self.base)
        here = seen @ to_base[:3, :3].T + to_base[:3, 3]
        if len(here) < 3:
            return np.concatenate([here[0], np.zeros(3)])
        turn = rigid_fit(self.reflectors, here)[:3, :3]
        return np.concatenate([here[0], abc_from_rotation(turn)])


def places(sessions: Sessions, row: PoseRow | IsoPoseRow) -> Floats:
    """Measured places (K, 3) of all reflectors of a visit, in the instrument's frame of the first session, mm."""
    session = sessions.session(row.visit)
    assert session is not None
    points: Sequence[tuple[float, ...]] = [row.point.xyz, *(each.xyz for each in row.others)]
    return sessions.to_first(session, np.array(points))


def station_row(context: StepContext) -> StationRow:
    """Where the instrument is now, by the nominal robot: good enough to aim."""
    found = Registration.of(context, Arm.of(context, nominal=True))
    sessions, now = Sessions.of(context), session_now(context)
    matrix = inverse_pose(found.base)
    if now != sessions.first:
        matrix = matrix @ inverse_pose(sessions.places[sessions.first]) @ sessions.places[now]
    return StationRow(session=now, source="poses", matrix=tuple(map(tuple, matrix.tolist())))
