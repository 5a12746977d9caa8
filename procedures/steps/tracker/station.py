"""Where the instrument is, whether it moved between visits to the nests, and in which session each pose is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Self, final

import numpy as np

from cellctl.devices import Vector3
from cellctl.files import InputError
from cellctl.formats import FlangeReflector, RobotFile, reflectors_of, station_of
from cellctl.kinematics import Floats, JointMap, SerialChain, inverse_pose, pose_from_xyz_abc
from cellctl.metrology import (
    InsensitiveDistances,
    KnownDistance,
    NestLoose,
    Points,
    StationState,
    constant_error,
    station_motion,
)
from cellctl.procedure import CellContext, StepContext
from cellctl.records import Rows
from procedures.steps.tracker.reflectors import NestsDisagree, points_of
from procedures.steps.tracker.rows import ConstantRow, MonumentsRow, NestRow, PoseRow, StationRow, VisitedRow, When

FIRST_SESSION = "1"
"""Name of the first session."""


def rough_station(context: CellContext) -> Floats:
    """The instrument in the robot's base frame (4, 4), mm, by the cell file."""
    station = station_of(context.cell)
    return pose_from_xyz_abc(station.xyz, station.abc)


def base_from_instrument(context: StepContext) -> Floats:
    """The instrument in the robot's base frame (4, 4), mm, as well as it is known now."""
    rows = context.recorded(StationRow)
    return np.array(rows[-1].matrix) if rows else rough_station(context)


def session_now(context: StepContext) -> str:
    """The data set's session of what is measured now."""
    rows = context.recorded(StationRow)
    return rows[-1].session if rows else FIRST_SESSION


def seen_from_instrument(context: StepContext, place: Floats) -> Vector3:
    """A place (3,) of the robot's base frame in the instrument's frame, mm."""
    x, y, z = (inverse_pose(base_from_instrument(context)) @ [*place, 1.0])[:3].tolist()
    return x, y, z


def reflector_called(context: CellContext, name: str) -> FlangeReflector:
    """The robot's reflector of that name, which a plan took from the same cell file."""
    return next(one for one in reflectors_of(context.cell).on_flange if one.id == name)


def reflector_at(context: CellContext, name: str, readings: Floats) -> Floats:
    """Places (N, 3) of a reflector at readings (N, n), deg, by the nominal robot, in its base frame, mm."""
    chain, joints = robot_of(context.robot_file)
    flange = chain.forward_flange(joints.model(readings))
    return np.asarray(flange[:, :3, 3] + flange[:, :3, :3] @ np.array(reflector_called(context, name).xyz))


@lru_cache(maxsize=1)
def robot_of(file: Path) -> tuple[SerialChain, JointMap]:
    """Chain and joint map of a robot file, which does not change in a run."""
    robot = RobotFile.load(file)
    return robot.chain(), robot.joint_map()


@final
@dataclass(frozen=True, eq=False)
class Sessions:
    """The sessions of a run. of_visit: session at each visit; places: session → the instrument, base frame.

    first: the session of the first pose that has one; a model's frame is the instrument's in it.
    """

    of_visit: Sequence[str]
    places: dict[str, Floats]
    first: str = FIRST_SESSION

    @classmethod
    def of(cls, rows: Rows) -> Self:
        """From the recorded visits; the last place of each session counts."""
        visits = sorted(rows.recorded(MonumentsRow), key=lambda row: row.visit)
        places = {row.session: np.array(row.matrix) for row in rows.recorded(StationRow)}
        found = cls([row.session for row in visits], places)
        known = (found.session(row.visit) for row in rows.recorded(PoseRow))
        return replace(found, first=next(filter(None, known), FIRST_SESSION))

    def session(self, visit: int) -> str | None:
        """The session of a pose that was measured before visit number `visit`; None if the station moved about then."""
        if not self.of_visit:
            return FIRST_SESSION
        before = self.of_visit[max(0, visit - 1)]
        after = self.of_visit[min(visit, len(self.of_visit) - 1)]
        return before if before == after else None

    def place(self, row: VisitedRow) -> Floats | None:
        """The measured place (3,), mm, in the instrument's frame of the first session; None without a session."""
        session = self.session(row.visit)
        return None if session is None else self.to_first(session, np.array([row.point.xyz]))[0]

    def to_first(self, session: str, places: Floats) -> Floats:
        """Places (N, 3) of the instrument's frame in `session` in that of the first session, mm."""
        if session == self.first:
            return places
        change = inverse_pose(self.places[self.first]) @ self.places[session]
        return np.asarray(places @ change[:3, :3].T + change[:3, 3])


MOVED, MOVING = StationState.MOVED.value, StationState.MOVING.value


@final
@dataclass(frozen=True, slots=True)
class Judged:
    """The row of a visit, and the instrument's new place if the station moved."""

    row: MonumentsRow
    station: StationRow | None


@final
@dataclass(frozen=True, eq=False)
class _Check:
    """One measurement of all nests."""

    visit: int
    points: Points
    time_s: float


def recorded_visits(context: StepContext) -> int:
    """How many visits were judged: the number of the present one."""
    return len(context.recorded(MonumentsRow))


def judged_visit(context: StepContext, tolerance_mm: float, when: When) -> Judged:
    """Judge the last measurement of the nests against those of the present session.

    A second motion between two visits in succession counts as moving. Raises NestsDisagree.
    """
    visits, session = context.recorded(MonumentsRow), session_now(context)
    first = next((row.visit for row in visits if row.session == session), len(visits))
    checks = [check for check in _checks(context) if check.visit >= first]
    number = len(visits)
    if len(checks) < 2:
        still = MonumentsRow(visit=number, when=when, session=session, verdict="still", shift_mm=0.0, p_still=1.0)
        return Judged(still, None)
    try:
        found = station_motion(
            [check.points for check in checks],
            [check.time_s for check in checks],
            seating_mm=reflectors_of(context.cell).centring_mm,
            tolerance_mm=tolerance_mm,
            names=[nest.id for nest in station_of(context.cell).nests],
        )
    except NestLoose as error:
        what, _, cure = (_other_constant(checks) or str(error)).rpartition(": ")
        raise NestsDisagree("tracker", what, cure) from error
    moved = found.verdict is StationState.MOVED
    verdict = StationState.MOVING if moved and visits[-1].verdict == MOVED else found.verdict
    station = None
    if verdict is StationState.MOVED and found.motion is not None:
        session = str(int(session) + 1)
        matrix = base_from_instrument(context) @ inverse_pose(found.motion.matrix)
        station = StationRow(session=session, source="moved", matrix=tuple(map(tuple, matrix.tolist())))
    row = MonumentsRow(
        visit=number,
        when=when,
        session=session,
        verdict=verdict.value,
        shift_mm=found.largest_mm,
        p_still=found.p_still,
    )
    return Judged(row, station)


def _other_constant(checks: Sequence[_Check]) -> str:
    """What to report if all ranges changed alike since the first check, which no loose nest does; else empty."""
    first, last = (np.linalg.norm(check.points.xyz, axis=1) for check in (checks[0], checks[-1]))
    change, spread = float((last - first).mean()), float((last - first).std())
    if abs(change) < max(_CHANGE_MM, 5.0 * spread):
        return ""
    way = "farther" if change > 0.0 else "nearer"
    return (
        f"every nest is measured {abs(change):.2f} mm {way} than at the first visit, so another reflector is in use, "
        "or another constant is set at the instrument: mount and set what the cell file states, then begin anew, for "
        "poses since the last visit are wrong"
    )


_CHANGE_MM = 1.0
"""Smallest change of all ranges that is taken for another reflector constant."""


def constant_row(context: StepContext) -> ConstantRow | None:
    """The reflector constant by the first measurement of the nests; None if the cell file certifies no distance.

    Raises InputError if the certified distances do not depend on the constant.
    """
    station = station_of(context.cell)
    names = [nest.id for nest in station.nests]
    known = [
        KnownDistance(names.index(each.between[0]), names.index(each.between[1]), each.mm, each.sigma)
        for each in station.distances
    ]
    if not known:
        return None
    try:
        found = constant_error(_checks(context)[0].points, known)
    except InsensitiveDistances as error:
        what, _, cure = str(error).rpartition(": ")
        raise InputError(context.cell.problem(("station", "distances"), what, cure)) from error
    return ConstantRow(
        error_mm=found.error_mm,
        sigma_mm=found.sigma_mm,
        zero_sigma_mm=found.zero_sigma_mm,
        p_value=found.p_value,
        sensitivity=found.sensitivity,
        wrong=found.wrong,
    )


def _checks(context: StepContext) -> list[_Check]:
    """Every measurement of all nests, in order; a visit after a motion has two."""
    names = [nest.id for nest in station_of(context.cell).nests]
    rows = context.recorded(NestRow)
    parts = [rows[start : start + len(names)] for start in range(0, len(rows), len(names))]
    return [
        _Check(part[0].visit, points_of([row.point for row in part]), part[-1].point.time_ns * 1e-9) for part in parts
    ]
