"""Instruments that measure where a reflector is: laser trackers, laser stations. One Protocol for all of them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, final, runtime_checkable

from cellctl.devices._protocols import Device, observes

Vector3 = tuple[float, float, float]
"""x, y, z in one frame: `(2500.0, -600.0, 900.0)`, mm unless stated."""

Matrix3 = tuple[Vector3, Vector3, Vector3]
"""Three rows of three."""


@final
@dataclass(frozen=True, slots=True)
class Weather:
    """The air between instrument and reflector: temperature °C, pressure hPa, relative humidity %."""

    temperature_c: float
    pressure_hpa: float
    humidity_percent: float


@final
@dataclass(frozen=True, slots=True)
class Reflector:
    """The reflector in use. constant_mm: added to every distance, by its certificate; centring_mm: 1 σ of its centre.

    acceptance_deg: half angle within which it reflects.
    """

    constant_mm: float
    centring_mm: float = 0.0
    acceptance_deg: float = 30.0


class Lock(StrEnum):
    """Whether the instrument follows the reflector."""

    NONE = "none"
    LOCKED = "locked"
    PREDICTED = "predicted"
    """The beam is interrupted; the instrument moves on as the reflector moved."""


@final
@dataclass(frozen=True, kw_only=True)
class MeasuredPoint:
    """The centre of a reflector at rest.

    xyz: mm, in the instrument's frame: right-handed; z along its standing axis, which is opposite to gravity while
    `levelled`. covariance: of xyz, mm², all parts. common: the part of it that all points of this set-up share (range
    scale and zero, collimation, refraction, centring). More samples reduce neither that nor the pointing of this aim.
    scatter: 1 σ of one sample along the beam, across it horizontally and vertically, mm, found from the samples (0 if
    there is one). faces: 1 or 2, the telescope's faces that were used. hz_rad, v_rad, range_mm: mean raw readings of
    the first face; hz clockwise, v from the zenith. time_ns: the cell's time in the middle of the samples; device_ms:
    the instrument's own time of the last sample. weather: what the instrument corrected its distances with.
    warnings: of the instrument, in words. noise_only: the accuracy is a profile of an instrument that does not speak
    this protocol: its noise is simulated, not its behaviour; every result must state it.
    """

    xyz: Vector3
    covariance: Matrix3
    common: Matrix3
    samples: int
    scatter: Vector3
    faces: int
    hz_rad: float
    v_rad: float
    range_mm: float
    time_ns: int
    device_ms: int
    levelled: bool
    weather: Weather | None
    accuracy: str
    noise_only: bool
    warnings: tuple[str, ...] = ()


@final
@dataclass(frozen=True, slots=True)
class TwoFaceError:
    """Half the difference between the faces, mm at the reflector and as the instrument's angles, rad."""

    hz_rad: float
    v_rad: float
    range_mm: float
    hz_mm: float
    v_mm: float


@observes
@runtime_checkable
class PointSource(Device, Protocol):
    """An instrument that finds a reflector, follows it and measures it at rest.

    Directions and points are in the instrument's frame, mm. Errors: TargetLost (beam broken, no or several reflectors
    found: aim again), OutOfRange (too near, too far: move), DeviceBusy (ask again later), NotLevelled, DeviceRefused,
    DeviceFault, DeviceLost. An instrument that sleeps is woken by the driver.
    """

    async def initialise(self, reflector: Reflector) -> None:
        """Set reflector, measuring program, automatic target recognition and compensator to a known state."""

    async def set_weather(self, weather: Weather) -> None:
        """Write the air's state to the instrument: it corrects its distances with it."""

    async def aim(self, place: Vector3, search_mm: float) -> None:
        """Turn to `place`, search the reflector within ± `search_mm` across the beam, lock onto it."""

    async def lock(self) -> Lock:
        """Whether it follows the reflector now."""

    async def measure(self, samples: int, *, faces: int = 1) -> MeasuredPoint:
        """The reflector that it is aimed at, from this many samples in each face."""

    async def two_face_error(self, samples: int) -> TwoFaceError:
        """Measure the reflector that it is aimed at in both faces."""

    async def levelled(self) -> bool:
        """Whether z is opposite to gravity: False without a compensator or with it off; raises NotLevelled if it is out
        of its range.
        """
