"""From recorded visits to the figures of ISO 9283."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellctl.files import InputError
from cellctl.kinematics import Floats
from cellctl.metrology.iso9283 import Performance, performance
from cellctl.procedure import StepContext
from procedures.steps.iso9283.cube import VARIED
from procedures.steps.iso9283.registration import Arm, Registration, places
from procedures.steps.iso9283.rows import (
    CubeRow,
    IsoFigures,
    IsoPoseRow,
    IsoRow,
    PointFigures,
    RegistrationRow,
    VariationFigures,
    When,
)
from procedures.steps.tracker.points import points_of
from procedures.steps.tracker.sessions import Sessions

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
