"""The plate with reflectors on the flange, learnt from its poses."""

from __future__ import annotations

from collections.abc import Sequence

from cellctl.devices import MeasuredPoint
from cellctl.formats.cell_sections import reflectors_of
from cellctl.metrology.nests import NestPlate, NestsDoNotFit, check_nests
from cellctl.metrology.points import Points
from cellctl.procedure import StepContext
from cellctl.records import Rows
from procedures.steps.tracker.pointing import NestsDisagree
from procedures.steps.tracker.points import points_of
from procedures.steps.tracker.rows import PoseRow

_ROUGH_MM = 2.0
"""1 σ of a reflector's place in the cell file, on each axis."""

_FIRST_POSES = 5
"""Poses whose plate checks the others."""


def plate_of(rows: Rows, most: int | None = None) -> NestPlate | None:
    """The plate as its poses show it, `most` of them at most; None if poses have one reflector."""
    poses = [points_of([row.point, *row.others]) for row in rows.recorded(PoseRow) if row.others]
    return NestPlate.learnt(poses[:most]) if poses else None


def alone(points: Points) -> Points:
    """Points without their common part, by which the plate's pose is found, and so checked."""
    return Points.of(points.xyz, points.alone)


def check_plate(context: StepContext, measured: Sequence[MeasuredPoint]) -> None:
    """Raise NestsDisagree if the distances between the reflectors are not the plate's: one measured twice, swapped."""
    given = reflectors_of(context.cell).on_flange[: len(measured)]
    plate = plate_of(context, most=_FIRST_POSES) or NestPlate.of([one.xyz for one in given], _ROUGH_MM)
    try:
        check_nests(alone(points_of(measured)), plate, tuple(one.id for one in given))
    except NestsDoNotFit as error:
        what, _, cure = str(error).rpartition(": ")
        raise NestsDisagree("tracker", what, cure) from error
