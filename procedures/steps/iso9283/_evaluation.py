"""From recorded visits to the figures of ISO 9283: registration of base and reflectors, evaluation, verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Literal, final

import numpy as np

from cellctl.calibration import ErrorFigures, base_and_tool, paired_verdict, rigid_fit
from cellctl.files import InputError
from cellctl.formats import ModelFile, RobotFile, nominal_chain
from cellctl.kinematics import Floats, abc_from_rotation, inverse_pose, pose
from cellctl.metrology import Performance, performance
from cellctl.procedure import StepContext
from cellctl.records import Figures, TableStateRow
from procedures.steps.iso9283.planning import VARIED
from procedures.steps.iso9283.rows import (
    CubeRow,
    IsoFigures,
    IsoPoseRow,
    IsoResult,
    IsoRow,
    IsoVerdict,
    PointFigures,
    RegistrationRow,
    VariationFigures,
    When,
)
from procedures.steps.tracker.measuring import NEAR_SHARE
from procedures.steps.tracker.reflectors import points_of
from procedures.steps.tracker.rows import MODEL_FILE, PoseRow, ReadModelRow, SetUpRow, StationRow
from procedures.steps.tracker.station import Sessions, reflector_called, session_now

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


_DRAWS = 20_000


def evaluated(context: StepContext) -> tuple[RegistrationRow, list[IsoRow]]:
    """The registration, and the figures before and, with a table, after. Raises InputError."""
    found = Registration.of(context, Arm.of(context))
    kinds: tuple[When, ...] = ("before", "after")
    rows = {when: [row for row in context.recorded(IsoPoseRow) if row.when == when] for when in kinds}
    return found.row(), [_iso_row(context, when, each, found) for when, each in rows.items() if each]


def _iso_row(context: StepContext, when: When, rows: Sequence[IsoPoseRow], found: Registration) -> IsoRow:
    sessions = Sessions.of(context)
    moved = {row.cycle for row in rows if sessions.session(row.visit) is None}
    kept = [row for row in rows if row.cycle not in moved]
    cycles = sorted({row.cycle for row in kept})
    if len(cycles) < 2:
        what = f"{len(cycles)} cycles were measured with the station still: two at least are needed"
        raise InputError(context.cell.problem(("station",), what, "stand the instrument firmly, then begin anew"))
    commands = found.commanded(np.array(context.recorded(CubeRow)[-1].readings))
    poses = {(row.cycle, row.place, row.side): found.attained(places(sessions, row)) for row in kept}
    attained = np.array([[poses[cycle, place, 0] for place in range(5)] for cycle in cycles])
    varied = None
    if any(row.side for row in kept):
        varied = np.array([[[poses[cycle, place, 1 + k] for place in VARIED] for k in range(3)] for cycle in cycles])
    result = performance(attained, commands, varied)
    noise = [_instrument_rp([row for row in kept if row.place == place]) for place in range(5)]
    figures = _figures(result, noise, len(moved), angles=bool(kept[0].others) and len(kept[0].others) >= 2)
    away = (attained[:, :, :3] - commands[:, :3]).round(6).tolist()
    return IsoRow(when=when, figures=figures, deviations=tuple(tuple(map(tuple, cycle)) for cycle in away))


def _figures(found: Performance, noise: Sequence[float], left_out: int, *, angles: bool) -> IsoFigures:
    return IsoFigures(
        cycles=found.cycles,
        complete=found.complete,
        left_out=left_out,
        points=tuple(
            PointFigures(
                accuracy=each.accuracy,
                of_axes=_vector(each.of_axes),
                of_angles=_vector(each.of_angles) if angles else None,
                repeatability=each.repeatability,
                angle_repeatability=_vector(each.angle_repeatability) if angles else None,
                instrument_rp=rp,
            )
            for each, rp in zip(found.points, noise, strict=True)
        ),
        distance_accuracy=found.distance.accuracy,
        distance_repeatability=found.distance.repeatability,
        variation=tuple(
            VariationFigures(position=each.position, angles=_vector(each.angles) if angles else None)
            for each in found.directions
        ),
    )


def _instrument_rp(rows: Sequence[IsoPoseRow]) -> float:
    """RP_l = l̄ + 3 S_l of the instrument's noise alone, mm, by simulation of the points' own covariance."""
    spread = points_of([row.point for row in rows]).alone.mean(axis=0)
    radii = np.linalg.norm(np.random.default_rng(9283).multivariate_normal(np.zeros(3), spread, _DRAWS), axis=1)
    return float(radii.mean() + 3.0 * radii.std())


def _vector(values: Floats) -> tuple[float, ...]:
    return tuple(values.tolist())


def verdict_of(context: StepContext, speed_percent: float, reflectors: int) -> IsoVerdict:
    """`better` if AP of the five points is smaller with the table by a paired test; `measured` without a table."""
    tests = {row.when: row.figures for row in context.recorded(IsoRow)}
    before, after = tests["before"], tests.get("after")
    setup, models = context.recorded(SetUpRow)[-1], context.recorded(ReadModelRow)
    point, registration = context.recorded(IsoPoseRow)[0].point, context.recorded(RegistrationRow)[-1]
    result = IsoResult(
        before=before,
        after=after,
        edge=context.recorded(CubeRow)[-1].edge,
        speed_percent=speed_percent,
        arrival_percent=speed_percent * NEAR_SHARE,
        load=setup.load,
        payload_kg=setup.payload_kg,
        reflectors=reflectors,
        model_from=models[-1].run if models else None,
    )
    tables = context.recorded(TableStateRow)
    verdict = "measured" if after is None else paired_verdict(_accuracy(before), _accuracy(after))
    return IsoVerdict(
        verdict=verdict,
        sentence=_sentence(before, after, verdict),
        before=_of_points(before),
        after=_of_points(after) if after else None,
        table=tables[-1] if tables else None,
        lines=tuple(_lines(result, registration, point.accuracy, noise_only=point.noise_only)),
        iso9283=result,
        accuracy=point.accuracy,
        noise_only=point.noise_only,
    )


def _accuracy(test: IsoFigures) -> np.ndarray:
    return np.array([each.accuracy for each in test.points])


def _of_points(test: IsoFigures) -> Figures:
    return Figures(**asdict(ErrorFigures.of(_accuracy(test))))


def _sentence(before: IsoFigures, after: IsoFigures | None, verdict: str) -> str:
    def range_of(values: list[float]) -> str:
        return f"{min(values):.3f} to {max(values):.3f} mm"

    def words(test: IsoFigures) -> str:
        accuracy, repeatability = ([getattr(p, name) for p in test.points] for name in ("accuracy", "repeatability"))
        return f"AP {range_of(accuracy)}, RP {range_of(repeatability)}"

    if after is None:
        return f"ISO 9283 by nominal joints: {words(before)} at P1 to P5."
    ends = {"better": "AP is better with the table.", "worse": "AP is worse with the table: it was rolled back."}
    end = ends.get(verdict, "AP is no better with the table: it was rolled back.")
    return f"ISO 9283 at P1 to P5, before: {words(before)}; after: {words(after)}. {end}"


def _lines(result: IsoResult, by: RegistrationRow, accuracy: str, *, noise_only: bool) -> Iterator[str]:
    for when, test in (("before", result.before), ("after", result.after)):
        if test is None:
            continue
        variation = ", ".join(f"{each.position:.3f}" for each in test.variation)
        more = f", vAP at P1, P2, P4: {variation} mm" if variation else ""
        line = f"AD {test.distance_accuracy:+.3f} mm, RD ± {test.distance_repeatability:.3f} mm"
        yield f"{when.capitalize()}: {line}{more}; {test.cycles} cycles."
        if not test.complete:
            yield f"The standard asks for 30 cycles: the figures {when} are of fewer."
        if test.left_out:
            yield f"{test.left_out} cycles {when} were left out: the station moved."
    orientation = "with orientation" if result.reflectors >= 3 else "position only: three reflectors give orientation"
    yield (
        f"Cube of {result.edge:g} mm; {result.speed_percent:g} % of axis speed, {result.arrival_percent:g} % on "
        f"arrival; load {result.load}, {result.payload_kg:g} kg; {orientation}."
    )
    yield (
        f"Base frame registered on {by.poses} other poses by the {by.by} robot (residual {by.residual:.3f} mm RMS), "
        "not on the judged points."
    )
    note = " (noise of such an instrument only)" if noise_only else ""
    most = max(each.instrument_rp for each in result.before.points)
    yield f"Instrument: accuracy profile {accuracy}{note}; its noise alone gives RP {most:.3f} mm."
