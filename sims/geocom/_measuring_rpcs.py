"""Procedures that measure: TMC, and BAP_MeasDistanceAngle."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import final

from sims.geocom._accuracy import ARCSEC
from sims.geocom._configuration import REFLECTORLESS_MODES, TRACKING_SECONDS
from sims.geocom._instrument import Instrument, Measured
from sims.geocom._optics import Direction, point_at
from sims.geocom._protocol import DONE, Answer, Code, Procedure, Procedures, Step, Value, Work, among

INCLINE_MODES = range(3)
STOP, DISTANCE, TRACK, CLEAR, SIGNAL, RESTART, RAPID_TRACK, NO_REFLECTOR, FREQUENCY = 0, 1, 2, 3, 4, 6, 8, 10, 11
COMMANDS = (STOP, DISTANCE, TRACK, CLEAR, SIGNAL, RESTART, RAPID_TRACK, NO_REFLECTOR, FREQUENCY)
NO_DISTANCE, CLEAR_DISTANCE, STOP_TRACKING = 1, 5, 6
BAP_MODES = range(7)
INCLINE_ACCURACY = 1.0 * ARCSEC

Values = Callable[[Direction, Measured], tuple[Value, ...]]
"""The values of a reply, from the circles' reading and the distance."""


def measuring_procedures(instrument: Instrument, announce: Callable[[str], object]) -> Procedures:
    """Of this instrument. announce: told the event's name when a distance begins."""
    return Measuring(instrument, announce).procedures()


@final
class Measuring:
    """The procedures and what they share."""

    def __init__(self, instrument: Instrument, announce: Callable[[str], object]) -> None:
        self._instrument = instrument
        self._announce = announce

    def procedures(self) -> Procedures:
        """By number."""
        return {
            2003: Procedure("i", lambda incline: self._angles(incline, self._angle_values)),
            2107: Procedure("i", lambda incline: self._angles(incline, lambda shown: (shown.hz, shown.v))),
            2008: Procedure("ii", self._do_measure),
            2082: Procedure("ii", partial(self._wait_and_read, values=self._coordinates)),
            2108: Procedure("ii", partial(self._wait_and_read, values=_polar)),
            2116: Procedure("ii", partial(self._wait_and_read, values=lambda *read: self._coordinates(*read)[:3])),
            2117: Procedure("", self._quick_distance),
            2167: Procedure("ii", partial(self._wait_and_read, values=self._full)),
            17017: Procedure("i", self._distance_and_angles),
        }

    def _angles(self, incline: int, values: Callable[[Direction], tuple[Value, ...]]) -> Step:
        among(incline, INCLINE_MODES)
        return Answer(self._instrument.angle_code(), values(self._instrument.read_circles()))

    def _angle_values(self, shown: Direction) -> tuple[Value, ...]:
        now = self._instrument.milliseconds()
        face = int(shown.face == 2)
        return (shown.hz, shown.v, self._accuracy(), now, *self._inclination(), now, face)

    def _do_measure(self, command: int, incline: int) -> Step:
        among(incline, INCLINE_MODES)
        among(command, COMMANDS)
        instrument = self._instrument
        if command == STOP:
            instrument.meter.stop()
        elif command == CLEAR:
            instrument.meter.clear()
        elif command == NO_REFLECTOR:
            return Answer(Code.NA)
        elif command in (DISTANCE, TRACK, RESTART, RAPID_TRACK):
            return self._begin(tracking=command != DISTANCE)
        return DONE

    def _begin(self, *, tracking: bool) -> Step:
        instrument = self._instrument
        if instrument.configuration.target_type == 1 or instrument.configuration.edm_mode in REFLECTORLESS_MODES:
            return Answer(Code.NA)  # this instrument measures to reflectors only
        self._announce("tracker.measure")
        instrument.start_distance(tracking=tracking)
        return DONE

    def _wait_and_read(self, wait_ms: int, incline: int, *, values: Values) -> Step:
        """Wait for the distance, at most `wait_ms`; then read."""
        among(incline, INCLINE_MODES)
        wait = min(max(0, wait_ms) * 1_000_000, self._instrument.meter.remaining_ns)
        return Work(wait, lambda: self._read(values)) if wait else self._read(values)

    def _read(self, values: Values) -> Step:
        instrument = self._instrument
        measured = instrument.meter.result()
        if measured is not None and measured.code is not Code.OK:
            return Answer(measured.code)
        if measured is None:
            code = instrument.angle_code()
            code = Code.TMC_ANGLE_OK if code is Code.OK else code
            return Answer(code, values(instrument.read_circles(), Measured(code, 0.0, instrument.kernel.now)))
        return Answer(instrument.distance_code(weak=measured.weak), values(instrument.read_circles(), measured))

    def _quick_distance(self) -> Step:
        """One quick distance with its angles."""
        began = self._begin(tracking=True)
        if began is not DONE:
            return began
        self._instrument.meter.start(TRACKING_SECONDS * self._instrument.build.edm_s, tracking=True)
        return Work(self._instrument.meter.remaining_ns, lambda: self._read(_polar))

    def _distance_and_angles(self, mode: int) -> Step:
        """Measure as the program says, then read."""
        among(mode, BAP_MODES)
        instrument = self._instrument
        if mode in (CLEAR_DISTANCE, STOP_TRACKING):
            instrument.meter.clear()
        if mode in (0, NO_DISTANCE, CLEAR_DISTANCE, STOP_TRACKING):
            return Answer(instrument.angle_code(), (*_polar(instrument.read_circles(), NONE), mode))
        began = self._begin(tracking=False)
        if began is not DONE:
            return began
        return Work(instrument.meter.remaining_ns, lambda: self._read(lambda *read: (*_polar(*read), mode)))

    def _coordinates(self, shown: Direction, measured: Measured) -> tuple[Value, ...]:
        east, north, height, instrument_height = self._instrument.configuration.station
        x, y, z = point_at(shown.hz, shown.v, measured.mm * 1e-3)
        place = (east + x, north + y, height + instrument_height + z)
        return (*place, self._ms(measured), *place, self._instrument.milliseconds())

    def _full(self, shown: Direction, measured: Measured) -> tuple[Value, ...]:
        polar = _polar(shown, measured)
        return (*polar[:2], self._accuracy(), *self._inclination(), polar[2], float(self._ms(measured)))

    def _accuracy(self) -> float:
        return self._instrument.build.profile.sample.arcsec * ARCSEC

    def _inclination(self) -> tuple[float, float, float]:
        """Across, along the line of sight, and its accuracy; the sensor's range ends it."""
        return (*self._instrument.inclination(), INCLINE_ACCURACY)

    def _ms(self, measured: Measured) -> int:
        return self._instrument.milliseconds(measured.end_ns)


NONE = Measured(Code.OK, 0.0, 0)


def _polar(shown: Direction, measured: Measured) -> tuple[Value, ...]:
    """Hz, V (rad) and slope distance (m)."""
    return (shown.hz, shown.v, measured.mm * 1e-3)
