"""Measures a reflector on the robot: motion by the stated side, motor currents on arrival, aim, then the point."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, final

import numpy as np
from pydantic import Field

from cellctl.clock import Clock
from cellctl.devices import (
    CellReadings,
    CurrentSource,
    DeviceError,
    JointReadings,
    MeasuredPoint,
    MotorCurrents,
    MovingRobot,
    NotLevelled,
    PointSource,
    TableRobot,
    Vector3,
)
from cellctl.files import InputError
from cellctl.formats import Currents, currents_of, reflectors_of, station_of
from cellctl.procedure import CellContext, StepContext, StepInputs, StepResult, step
from cellctl.records import Row
from procedures.steps.contact_search import rejoin
from procedures.steps.table_push import require_in_force
from procedures.steps.tracker.pose_plans import PosePlan
from procedures.steps.tracker.reflectors import NestsDisagree, check_plate
from procedures.steps.tracker.rows import CompensatedRow, MonumentsRow, PoseRow, ReturnRow, TargetsRow, TurnRow
from procedures.steps.tracker.station import reflector_at, robot_of, seen_from_instrument

_LOOKS = 3
"""How often a reflector that is not at rest is measured in one attempt."""

_TILTED = "its compensator is out of its range: the last point is not corrected for the tilt, and is not recorded"
_LEVEL = (
    "level the instrument and stand it firmly; then resume: the nests show how far it moved. "
    "If the poses have not begun, begin anew"
)

NEEDS = {"robot": MovingRobot, "tracker": PointSource}
USES = {"plc": CellReadings, "drives": CurrentSource}

NEAR_SHARE = 0.4
"""Share of the transfer speed from the approach to the pose."""

_CURRENT_SAMPLES = 10


@final
class ScaledCurrents:
    """A source of motor currents with scale and offset of the cell file applied, once."""

    def __init__(self, source: CurrentSource, settings: Currents) -> None:
        self._source, self._settings = source, settings

    async def currents(self, samples: int) -> MotorCurrents:
        """Amperes of A1…An, and their σ; raises as `CurrentSource.currents` does."""
        found = await self._source.currents(samples)
        amperes, sigma_a = self._settings.applied(found.amperes), self._settings.applied_sigma(found.sigma_a)
        return replace(found, amperes=amperes, sigma_a=sigma_a)


def current_source(context: StepContext, axes: int) -> ScaledCurrents | None:
    """The source that `currents:` of the cell file names, for a robot of `axes` axes; None if it names none.

    The step needs `robot` and uses `drives`. Raises InputError for an error in the cell file.
    """
    if "currents" not in context.cell.data:
        return None
    settings = currents_of(context.cell, axes)
    device = context.device("robot") if settings.source == "robot" else context.optional_device("drives")
    return ScaledCurrents(device, settings) if device else None


@final
class NotSettled(DeviceError):
    """The samples of a point scatter more than the limit: the reflector or the air is not at rest."""


@final
@dataclass(frozen=True, slots=True)
class Settling:
    """samples: for a point. wait_s: before it, and before it is measured again. scatter_mm: limit, 1 σ of a sample."""

    samples: int
    wait_s: float
    scatter_mm: float


async def settled_point(
    tracker: PointSource, clock: Clock, place: Vector3, search_mm: float, settling: Settling
) -> MeasuredPoint:
    """Aim at `place`, in the instrument's frame, mm, and measure the reflector there.

    Raises NotSettled, NotLevelled for a point without correction for the tilt, and the instrument's errors.
    """
    await tracker.aim(place, search_mm)
    for _ in range(_LOOKS):
        await clock.sleep(settling.wait_s)
        point = await tracker.measure(settling.samples)
        if not point.levelled:
            raise NotLevelled(tracker.name, _TILTED, _LEVEL)
        if max(point.scatter) <= settling.scatter_mm:
            return point
    what = (
        f"the samples of a reflector at {point.range_mm:.0f} mm scatter by {max(point.scatter):.3f} mm (1 σ) in "
        f"{_LOOKS} measurements, more than the limit of {settling.scatter_mm:g} mm"
    )
    cure = "does the robot vibrate, is the reflector loose, does warm air cross the beam? else raise scatter_limit"
    raise NotSettled(tracker.name, what, cure)


class PointInputs(StepInputs):
    """How a point is measured: samples, seconds at rest before it, limit of the samples' scatter (1 σ), mm."""

    samples: Annotated[int, Field(ge=1, le=200)] = 3
    settle_s: Annotated[float, Field(ge=0, le=60)] = 0.5
    scatter_mm: Annotated[float, Field(gt=0)] = 1.0

    @property
    def settling(self) -> Settling:
        """For the measurement of a point."""
        return Settling(self.samples, self.settle_s, self.scatter_mm)


class MeasureInputs(PointInputs):
    """A planned pose, the share of axis speed of transfers, percent, and how many reflectors to measure there."""

    pose: PosePlan
    reflectors: Annotated[int, Field(ge=1, le=8)] = 1
    transfer_percent: Annotated[float, Field(gt=0, le=100)] = 20.0


class Measured(StepResult):
    """The measured point in the instrument's frame, mm."""

    xyz: list[float]


def _check_currents(context: CellContext, known: Mapping[str, Any]) -> None:
    """Raise InputError for an error in the cell file's `currents:`."""
    if "currents" not in context.cell.data:
        return
    source = currents_of(context.cell, robot_of(context.robot_file)[0].n).source
    if source not in ("drives", "robot"):
        what = f"the campaign takes no currents from '{source}'"
        raise InputError(context.cell.problem(("currents", "source"), what, "drives or robot"))


@step("tracker.measure", check=_check_currents, needs=NEEDS, uses=USES, errors=(NotSettled, NestsDisagree))
async def measure(context: StepContext, inputs: MeasureInputs) -> Measured:
    """Go to a pose by its approach, take the motor currents, measure the reflector."""
    robot: MovingRobot = context.device("robot")
    near = inputs.transfer_percent * NEAR_SHARE
    return await measure_pose(context, inputs, lambda: robot.move(tuple(inputs.pose.joints), near))


@step("tracker.measure_compensated", needs={**NEEDS, "robot": TableRobot}, uses=USES, errors=(NotSettled,))
async def measure_compensated(context: StepContext, inputs: MeasureInputs) -> Measured:
    """Go to a row of the run's table by its approach, take the motor currents, measure the reflector."""
    robot: TableRobot = context.device("robot")

    async def to_row() -> JointReadings:
        assert inputs.pose.row is not None
        await require_in_force(robot, context.recorded(TargetsRow)[-1].table)
        return await robot.move_to_row(inputs.pose.row, inputs.transfer_percent * NEAR_SHARE)

    return await measure_pose(context, inputs, to_row)


async def measure_pose(
    context: StepContext,
    inputs: MeasureInputs,
    arrive: Callable[[], Awaitable[JointReadings]],
    here: JointReadings | None = None,
) -> Measured:
    """Approach from `here` (None: the actual joints), `arrive`, measure, record; the row is the pose's own."""
    pose, robot = inputs.pose, context.device("robot")
    await approach(robot, pose, inputs.transfer_percent, here)
    fields = await measured_fields(context, pose, await arrive(), inputs.settling)
    if inputs.reflectors > 1 and pose.kind in ("fit", "test"):
        fields["others"] = await measured_plate(context, fields, inputs.reflectors, inputs.settling)
    await context.record(_row(pose, fields))
    return Measured(xyz=list(fields["point"].xyz))


async def measured_fields(
    context: StepContext, pose: PosePlan, joints: JointReadings, settling: Settling
) -> dict[str, Any]:
    """Measure the reflector of `pose` with the robot at `joints`: the fields of a `VisitedRow`."""
    currents = await _currents(context, len(joints))
    place = seen_from_instrument(context, reflector_at(context, pose.reflector, _array(joints))[0])
    point = await settled_point(context.device("tracker"), context.clock, place, _search_mm(context), settling)
    plc: CellReadings | None = context.optional_device("plc")
    return {
        "number": pose.number,
        "reflector": pose.reflector,
        "joints": tuple(round(value, 6) for value in joints),
        "commanded": tuple(pose.joints),
        "direction": tuple(pose.direction),
        "visit": len(context.recorded(MonumentsRow)),
        "arm_c": (await plc.temperatures()).arm if plc else None,
        "currents": currents,
        "point": point,
        "attempt": context.attempt,
    }


async def measured_plate(
    context: StepContext, fields: Mapping[str, Any], count: int, settling: Settling
) -> tuple[MeasuredPoint, ...]:
    """Measure the plate's reflectors 2 to `count` after the first. Raises NestsDisagree if they do not fit it."""
    joints = _array(fields["joints"])
    points = []
    for reflector in reflectors_of(context.cell).on_flange[1:count]:
        place = seen_from_instrument(context, reflector_at(context, reflector.id, joints)[0])
        tracker = context.device("tracker")
        points.append(await settled_point(tracker, context.clock, place, _search_mm(context), settling))
    check_plate(context, [fields["point"], *points])
    return tuple(points)


async def approach(robot: MovingRobot, pose: PosePlan, percent: float, here: JointReadings | None = None) -> None:
    """To the approach: along the planned way, or, after an interruption, from where the robot is on it.

    here: as `rejoin` has it.
    """
    way = [tuple(joints) for joints in (pose.origin, *pose.way, pose.joints)]
    passed = await rejoin(robot, way, percent, here)
    for joints in way[min(passed + 1, len(way) - 2) : -1]:
        await robot.move(joints, percent)


async def _currents(context: StepContext, axes: int) -> MotorCurrents | None:
    """The motor currents on arrival, before the brakes close, from the source that the cell file names."""
    source = current_source(context, axes)
    return await source.currents(_CURRENT_SAMPLES) if source else None


def _row(pose: PosePlan, fields: dict[str, Any]) -> Row:
    if pose.kind == "turn":
        assert pose.axis is not None
        return TurnRow(**fields, axis=pose.axis)
    if pose.kind == "return":
        return ReturnRow(**fields)
    if pose.kind == "compensated":
        assert pose.row is not None
        assert pose.target is not None
        return CompensatedRow(**fields, row=pose.row, target=tuple(pose.target))
    assert pose.kind != "cube", "a visit to the ISO cube has a step of its own"
    return PoseRow(**fields, set=pose.kind)


def _search_mm(context: StepContext) -> float:
    return station_of(context.cell).search_mm


def _array(joints: JointReadings) -> Any:
    return np.array([joints])
