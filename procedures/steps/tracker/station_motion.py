"""Judges the visits to the nests: motion of the station, and the reflector constant by certified distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from cellctl.files import InputError
from cellctl.formats.cell_sections import reflectors_of, station_of
from cellctl.kinematics import inverse_pose
from cellctl.metrology.instrument_checks import InsensitiveDistances, KnownDistance, constant_error
from cellctl.metrology.monuments import NestLoose, StationState, station_motion
from cellctl.metrology.points import Points
from cellctl.procedure import StepContext
from procedures.steps.tracker.pointing import NestsDisagree
from procedures.steps.tracker.points import points_of
from procedures.steps.tracker.rows import ConstantRow, MonumentsRow, NestRow, StationRow, When
from procedures.steps.tracker.station import base_from_instrument, session_now

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
