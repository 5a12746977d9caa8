"""Aims the instrument at a reflector and measures it once it is at rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from cellctl.clock import Clock
from cellctl.devices import DeviceError, MeasuredPoint, NotLevelled, PointSource, Vector3

_LOOKS = 3
"""How often a reflector that is not at rest is measured in one attempt."""

_TILTED = "its compensator is out of its range: the last point is not corrected for the tilt, and is not recorded"
_LEVEL = (
    "level the instrument and stand it firmly; then resume: the nests show how far it moved. "
    "If the poses have not begun, begin anew"
)


@final
class NotSettled(DeviceError):
    """The samples of a point scatter more than the limit: the reflector or the air is not at rest."""


@final
class NestsDisagree(DeviceError):
    """The nests moved against each other: one is loose, badly seated, or the station moved in the visit."""


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
