"""The plate with reflectors on the flange, learnt from its first pose."""

from __future__ import annotations

from collections.abc import Sequence

from cellctl.devices import MeasuredPoint
from cellctl.formats.station import reflectors_of
from cellctl.metrology.nests import NestPlate, NestsDoNotFit, check_nests
from cellctl.metrology.points import Points
from cellctl.procedure import StepContext
from procedures.steps.tracker.pointing import NestsDisagree
from procedures.steps.tracker.points import points_of
from procedures.steps.tracker.rows import PoseRow

_ROUGH_MM = 2.0
"""1 σ of a reflector's place in the cell file, on each axis."""


def plate_of(context: StepContext) -> NestPlate | None:
    """The plate as its first pose shows it; None if poses have one reflector."""
    first = next((row for row in context.recorded(PoseRow) if row.others), None)
    return NestPlate.learnt(points_of([first.point, *first.others])) if first else None


def alone(points: Points) -> Points:
    """Points without their common part, by which the plate's pose is found, and so checked."""
    return Points.of(points.xyz, points.alone)


def check_plate(context: StepContext, measured: Sequence[MeasuredPoint]) -> None:
    """Raise NestsDisagree if the distances between the reflectors are not the plate's: one measured twice, swapped."""
    given = reflectors_of(context.cell).on_flange[: len(measured)]
    plate = plate_of(context) or NestPlate.of([one.xyz for one in given], _ROUGH_MM)
    try:
        check_nests(alone(points_of(measured)), plate, tuple(one.id for one in given))
    except NestsDoNotFit as error:
        what, _, cure = str(error).rpartition(": ")
        raise NestsDisagree("tracker", what, cure) from error
