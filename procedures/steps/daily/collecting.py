"""What a run of the daily check measured, from its rows."""

from __future__ import annotations

import numpy as np

from cellctl.devices import DeviceFault
from cellctl.procedure import StepContext
from procedures.steps.daily.rows import DayPoints, Matrix
from procedures.steps.tracker.points import points_of
from procedures.steps.tracker.rows import NestRow, PoseRow, SetUpRow
from procedures.steps.tracker.sessions import Sessions


def day_points(context: StepContext, baseline: str) -> DayPoints:
    """Points and nests of this run; a nest is the mean of its visits.

    Raises DeviceFault if the station moved in the run.
    """
    rows = sorted(context.recorded(PoseRow), key=lambda row: row.number)
    sessions = Sessions.of(context)
    if any(sessions.session(row.visit) != sessions.first for row in rows):
        what = "its station moved between the first and the last visit to the nests: the points cannot be compared"
        raise DeviceFault("tracker", what, "stand the instrument firmly, then run the check again")
    nests: dict[str, list[NestRow]] = {}
    for row in context.recorded(NestRow):
        nests.setdefault(row.nest, []).append(row)
    found = [points_of([row.point for row in visits]) for visits in nests.values()]
    setup = context.recorded(SetUpRow)[-1]
    return DayPoints(
        baseline=baseline,
        robot=context.identity("robot").serial,
        payload_kg=setup.payload_kg,
        accuracy=rows[0].point.accuracy,
        commanded=tuple(row.commanded for row in rows),
        points=tuple(row.point.xyz for row in rows),
        nest_names=tuple(nests),
        nests=_rows([each.xyz.mean(axis=0) for each in found]),
        spread=tuple(_rows(each.alone.mean(axis=0) / len(each)) for each in found),
    )


def _rows(values: object) -> Matrix:
    return tuple(tuple(row) for row in np.asarray(values, float).tolist())
