"""The laser station: telescope, target recognition, lock, distance meter and what they come to as readings."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import cos, dist, radians, sin
from typing import final

from sims.geocom import _optics
from sims.geocom._accuracy import ARCSEC, BEAM_RAD, Noise, Profile, set_up_of
from sims.geocom._configuration import TRACKING_MODES, Configuration
from sims.geocom._optics import COMPENSATOR_RAD, AxisErrors, Direction, Seen, Sight, Vector
from sims.geocom._protocol import Code, seconds
from sims.geocom._telescope import Lock, State, Telescope
from sims.kernel import Event, Kernel

STEADY_MM = 1.0
"""A reflector that moves further during a measurement makes it unstable."""


@final
@dataclass(frozen=True, slots=True)
class Measured:
    """A finished measurement: a distance, or the reason why there is none. end_ns: when it ended."""

    code: Code
    mm: float
    end_ns: int
    weak: bool = False


@final
class DistanceMeter:
    """Measures with `seen()`, the reflector in the beam, and `show`, which makes a shown distance of a true one."""

    def __init__(
        self,
        kernel: Kernel,
        profile: Profile,
        seen: Callable[[], Seen | None],
        show: Callable[[Seen], float],
    ) -> None:
        self._kernel = kernel
        self._profile = profile
        self._seen = seen
        self._show = show
        self._ending: Event | None = None
        self._end_ns = 0
        self._began_at: Vector | None = None
        self._tracking = False
        self._result: Measured | None = None

    @property
    def remaining_ns(self) -> int:
        """Until the present measurement ends; 0 where none goes on."""
        return max(0, self._end_ns - self._kernel.now) if self._ending and self._ending.pending else 0

    def start(self, duration_s: float, *, tracking: bool) -> None:
        """Begin a measurement; `tracking`: one after another from then on."""
        self.clear()
        first = self._seen()
        self._began_at = first.xyz if first and not tracking else None
        self._tracking = tracking
        self._end_ns = self._kernel.now + seconds(duration_s)
        self._ending = self._kernel.at(self._end_ns, self._finish)

    def stop(self) -> None:
        """Break off what goes on; a finished distance stays."""
        self._tracking = False
        if self._ending is not None:
            self._ending.cancel()

    def clear(self) -> None:
        """Break off, and forget the distance."""
        self.stop()
        self._result = None

    def result(self) -> Measured | None:
        """The finished measurement, the newest while tracking; None without one."""
        if self._result is not None and self._tracking and self.remaining_ns == 0:
            self._finish()
        return self._result

    def _finish(self) -> None:
        self._result = self._measure()

    def _measure(self) -> Measured:
        now, seen = self._kernel.now, self._seen()
        if seen is None:
            return Measured(Code.TMC_DIST_ERROR, 0.0, now)
        if seen.distance_mm < self._profile.least_mm:
            return Measured(Code.EDM_DIST_TOO_SHORT, 0.0, now)
        if seen.distance_mm > self._profile.most_mm:
            return Measured(Code.EDM_DISTRANGE, 0.0, now)
        if self._began_at is not None and dist(self._began_at, seen.xyz) > STEADY_MM:
            return Measured(Code.EDM_FLUKT, 0.0, now)
        return Measured(Code.OK, self._show(seen), now, seen.weak)


HOME = Direction(0.0, radians(90.0))
WORST_PPM = 20.0


class Power(Enum):
    """Whether it answers."""

    ON = "on"
    ASLEEP = "asleep"
    OFF = "off"


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class Build:
    """What this instrument is like: its noise profile, errors of its axes (arc seconds) and times."""

    seed: int
    profile: Profile
    noise_scale: float = 1.0
    collimation_arcsec: float = 0.0
    index_arcsec: float = 0.0
    edm_s: float = 1.0
    fine_adjust_s: float = 2.0
    lock_s: float = 1.0
    predict_s: float = 1.5
    speed_deg_s: float = 45.0


@final
class Instrument:
    """Its state and readings. Movements that take time are in `aiming`."""

    def __init__(self, kernel: Kernel, sight: Sight, build: Build) -> None:
        self.kernel = kernel
        self.sight = sight
        self.build = build
        self.configuration = Configuration()
        self.power = Power.ON
        self.telescope = Telescope(build.speed_deg_s, HOME)
        self.noise = Noise(build.seed, build.profile, build.noise_scale)
        self.lock = Lock(kernel, self.telescope, self.seen, sight.changes, seconds(build.predict_s))
        self.meter = DistanceMeter(kernel, build.profile, self.in_beam, self._shown_mm)
        self.controller_on = False
        self._errors = AxisErrors(build.collimation_arcsec * ARCSEC, build.index_arcsec * ARCSEC)
        self._set_up = set_up_of(build.seed, build.profile, build.noise_scale)
        draw = random.Random(f"{build.seed} tracker clock")
        self._rate = 1 + draw.uniform(-WORST_PPM, WORST_PPM) * 1e-6
        self._first_ms = draw.randrange(1_000_000)

    def milliseconds(self, time_ns: int | None = None) -> int:
        """Of the instrument's own clock, which is a little fast or slow; now, or at another time of the cell."""
        return self._first_ms + int((self.kernel.now if time_ns is None else time_ns) * self._rate / 1e6)

    def inclination(self) -> tuple[float, float]:
        """By which the standing axis leans to the right and forwards, rad; no more than the sensor's range."""
        about_x, about_y = self.sight.tilt
        hz = self.axis().hz
        both = (about_x * sin(hz) + about_y * cos(hz), about_y * sin(hz) - about_x * cos(hz))
        across, along = (max(-COMPENSATOR_RAD, min(COMPENSATOR_RAD, part)) for part in both)
        return across, along

    def targets(self) -> tuple[Seen, ...]:
        """The reflectors that can be seen now, in the frame of the readings."""
        return self.sight.targets(compensated=self.configuration.compensator)

    def seen(self, target: str) -> Seen | None:
        """One reflector; None while it cannot be seen."""
        found = self.sight.targets(compensated=self.configuration.compensator, wanted=lambda seen: seen.id == target)
        return found[0] if found else None

    def axis(self) -> Direction:
        """Where the telescope points now."""
        return self.telescope.at(self.kernel.now)

    def in_beam(self) -> Seen | None:
        """The reflector that the distance meter would measure now."""
        self.lock.update()
        axis = self.axis()
        near = self.sight.targets(
            compensated=self.configuration.compensator,
            wanted=lambda seen: _optics.nearest((seen,), axis, BEAM_RAD) is not None,
        )
        return _optics.nearest(near, axis, BEAM_RAD)

    def read_circles(self) -> Direction:
        """Hz and V as they are shown now, with this reading's noise."""
        seen = self.in_beam()
        axis = self.axis()
        if seen is not None:
            self.noise.at(self.sight.pose())
            across, up = self.noise.angles(seen.id, seen.distance_mm)
            down = -up if axis.face == 1 else up  # V counts the other way in face 2
            axis = Direction(axis.hz + across / max(abs(sin(axis.v)), 1e-3), axis.v + down)
        shown = self._errors.reading(axis)
        return Direction((shown.hz + self.configuration.orientation) % _optics.TURN, shown.v)

    def commanded(self, hz: float, v: float) -> Direction:
        """Where the telescope points when the circles show these."""
        return self._errors.direction(Direction(hz - self.configuration.orientation, v % _optics.TURN))

    def orient(self, hz: float) -> None:
        """From now on the present direction reads `hz`."""
        shown = self._errors.reading(self.axis())
        self.configuration.orientation = _optics.difference(hz, shown.hz)

    def start_distance(self, *, tracking: bool) -> None:
        """Begin a distance with the measuring mode that is set; `tracking`: one after another."""
        tracking = tracking or self.configuration.edm_mode in TRACKING_MODES
        self.meter.start(self.configuration.measuring_seconds(self.build.edm_s), tracking=tracking)

    def stop_movement(self) -> None:
        """Motors and lock off, the distance forgotten."""
        self.lock.release()
        self.telescope.stop(self.kernel.now)
        self.meter.clear()

    def angle_code(self) -> Code:
        """Whether the angles are corrected for the tilt."""
        if self._cannot_level:
            return Code.INSTRUMENT_TILT
        return Code.TMC_ANGLE_NO_FULL_CORRECTION if self._uncorrected else Code.OK

    def distance_code(self, *, weak: bool) -> Code:
        """As `angle_code`, of a reading with a distance. weak: little light came back."""
        if self._cannot_level:
            return Code.INSTRUMENT_TILT
        if self._uncorrected:
            return Code.TMC_NO_FULL_CORRECTION
        return Code.TMC_ACCURACY_GUARANTEE if weak else Code.OK

    def switch(self, power: Power) -> None:
        """On, asleep or off; whatever it does ends."""
        self.stop_movement()
        self.power = power

    @property
    def lock_state(self) -> State:
        """As MOT_ReadLockStatus gives it."""
        self.lock.update()
        return self.lock.state

    @property
    def _cannot_level(self) -> bool:
        return self.configuration.compensator and self.sight.grossly_tilted

    @property
    def _uncorrected(self) -> bool:
        return self.configuration.compensator and not self.sight.compensator_works

    def _shown_mm(self, seen: Seen) -> float:
        """The distance that the instrument shows for a reflector at its true place."""
        self.noise.at(self.sight.pose())
        true_mm = seen.distance_mm
        shown = _optics.measured_mm(
            true_mm,
            ppm_set=self.configuration.ppm,
            ppm_true=self.sight.ppm(),
            constant_set_mm=self.configuration.constant_mm,
            constant_true_mm=seen.constant_mm,
        )
        return shown + self._set_up.shift_mm(true_mm) + self.noise.distance(seen.id, true_mm)
