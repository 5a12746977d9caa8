"""Movements of the telescope (positioning, search, lock, change of face) and the procedures that order them."""

from __future__ import annotations

from collections.abc import Callable
from math import degrees, pi
from typing import final

from sims.geocom import _optics
from sims.geocom._accuracy import FIELD_OF_VIEW_RAD
from sims.geocom._instrument import Instrument
from sims.geocom._optics import Direction, Seen
from sims.geocom._protocol import (
    BOOLEANS,
    DONE,
    Answer,
    BadParameter,
    Code,
    Procedure,
    Procedures,
    Step,
    Work,
    among,
    getter,
    positive,
    seconds,
    setter,
)

SEARCH_DEG2_S = 20.0
"""Solid angle that a search sweeps, square degrees a second."""

LONGEST_SEARCH_S = 5.0
"""A fine adjustment gives up then, whatever the time-outs of the positioning are (GeoCOM Reference Manual)."""

SWEEP_DEG_S = 30.0
"""Rate of a search with the fan of light, about the standing axis."""

NARROWEST_RAD = FIELD_OF_VIEW_RAD / 4
"""Half of the smallest window: what the camera sees however small a window is asked for."""

SWING_RAD = pi / 20
"""10 gon."""

ATTEMPT_S = 2.0
"""A search that finds nothing, besides its sweep."""


@final
class Aiming:
    """Each method begins a movement and returns what it comes to. announce: told the event's name."""

    def __init__(self, instrument: Instrument, announce: Callable[[str], object]) -> None:
        self._instrument = instrument
        self._announce = announce

    def position(self, hz: float, v: float, *, recognise: bool) -> Step:
        """Turn to where the circles show `hz`, `v`; `recognise`: then adjust to the reflector nearby."""
        if recognise and not self._instrument.configuration.recognition:
            return Answer(Code.AUT_NOT_ENABLED)
        self._announce("tracker.aim")
        return self._turn(self._instrument.commanded(hz, v), recognise=recognise)

    def change_face(self, *, recognise: bool) -> Step:
        """Turn to the same direction in the other face."""
        if recognise and not self._instrument.configuration.recognition:
            return Answer(Code.AUT_NOT_ENABLED)
        return self._turn(self._instrument.axis().other_face(), recognise=recognise)

    def fine_adjust(self, half_hz: float, half_v: float) -> Step:
        """Find the one reflector within the window about the axis, and point at it."""
        instrument = self._instrument
        if not instrument.configuration.recognition:
            return Answer(Code.AUT_NOT_ENABLED)
        instrument.stop_movement()
        start = instrument.axis()
        window = max(half_hz, NARROWEST_RAD), max(half_v, NARROWEST_RAD)
        found = _optics.in_window(self._candidates(start), start, *window)
        if len(found) > 1:
            return self._give_up(start, Code.AUT_MULTIPLE_TARGETS, 0.0)
        reach = max(map(abs, _optics.offsets(start, found[0].xyz))) if found else max(window)
        sweep_s = self._sweep_s(reach)
        if sweep_s > LONGEST_SEARCH_S:
            return self._give_up(start, Code.AUT_TIMEOUT, LONGEST_SEARCH_S)
        if not found:
            return self._give_up(start, Code.AUT_NO_TARGET, sweep_s)
        adjust_s = instrument.build.fine_adjust_s
        return Work(seconds(adjust_s + sweep_s), lambda: self._adjusted(found[0].id, start))

    def search_window(self) -> Step:
        """The fan of light over the working area: the first reflector found."""
        configuration = self._instrument.configuration
        if not configuration.area_on:
            return Answer(Code.AUT_NO_WORKING_AREA)
        hz, v, range_hz, range_v = configuration.area
        centre = self._instrument.commanded(hz, v)
        seen = _optics.in_window(self._instrument.targets(), centre, range_hz / 2, range_v / 2)
        seen.sort(key=lambda one: _optics.difference(_optics.direction_of(one.xyz, centre.face).hz, centre.hz))
        return self._fan(seen, degrees(range_hz))

    def search_next(self, *, clockwise: bool, swing: bool) -> Step:
        """The fan of light about the standing axis from here on: the next reflector in that sense of rotation.

        swing: the search begins 10 gon back.
        """
        axis = self._instrument.axis()
        begin = SWING_RAD if swing else -FIELD_OF_VIEW_RAD

        def way(one: Seen) -> float:
            ahead = _optics.direction_of(one.xyz, axis.face).hz - axis.hz
            return ((ahead if clockwise else -ahead) + begin) % _optics.TURN

        seen = list(self._instrument.targets())
        seen.sort(key=way)
        return self._fan(seen, degrees(way(seen[0])) if seen else 360.0)

    def lock_in(self) -> Step:
        """Follow the reflector in the field of view."""
        instrument = self._instrument
        if not instrument.configuration.lock:
            return Answer(Code.AUT_NOT_ENABLED)
        return Work(seconds(instrument.build.lock_s), self._locked)

    def _turn(self, target: Direction, *, recognise: bool) -> Step:
        instrument = self._instrument
        instrument.stop_movement()
        duration = instrument.telescope.turn(target, instrument.kernel.now)
        limit = seconds(max(instrument.configuration.time_out_s))
        if duration > limit:
            return Work(limit, lambda: self._stopped(Code.AUT_TIMEOUT))
        return Work(duration, self._recognise if recognise else lambda: DONE)

    def _recognise(self) -> Step:
        """After positioning: adjust within the user's spiral, and lock where lock mode is on."""
        spiral = self._instrument.configuration.spiral
        return _after(self.fine_adjust(spiral[0] / 2, spiral[1] / 2), self._lock_if_on)

    def _lock_if_on(self) -> Step:
        return self.lock_in() if self._instrument.configuration.lock else DONE

    def _stopped(self, code: Code) -> Step:
        self._instrument.stop_movement()
        return Answer(code)

    def _candidates(self, axis: Direction) -> tuple[Seen, ...]:
        return self._instrument.sight.with_second(self._instrument.targets(), axis)

    def _adjusted(self, target: str, start: Direction) -> Step:
        """The end of an adjustment: the reflector may have gone meanwhile."""
        found = self._instrument.seen(target)
        if found is None:
            return self._give_up(start, Code.AUT_NO_TARGET, 0.0)
        self._point_at(found)
        return DONE

    def _point_at(self, seen: Seen) -> None:
        instrument = self._instrument
        towards = _optics.direction_of(seen.xyz, instrument.axis().face)
        instrument.telescope.point(towards, instrument.kernel.now)

    def _give_up(self, start: Direction, code: Code, sweep_s: float) -> Step:
        """Turn back to where the search began."""

        def back() -> Step:
            self._instrument.telescope.point(start, self._instrument.kernel.now)
            return Answer(code)

        return Work(seconds(ATTEMPT_S + sweep_s), back)

    def _sweep_s(self, reach_rad: float) -> float:
        """A square spiral out to this offset; what is in the field of view needs none."""
        return 0.0 if reach_rad <= FIELD_OF_VIEW_RAD else (2 * degrees(min(reach_rad, 10.0))) ** 2 / SEARCH_DEG2_S

    def _fan(self, seen: list[Seen], sweep_deg: float) -> Step:
        instrument = self._instrument
        instrument.stop_movement()
        start = instrument.axis()
        sweep_s = min(sweep_deg, 360.0) / SWEEP_DEG_S
        if not seen:
            return self._give_up(start, Code.AUT_NO_TARGET, sweep_s)
        target = seen[0].id
        return Work(seconds(ATTEMPT_S + sweep_s), lambda: self._adjusted(target, start))

    def _locked(self) -> Step:
        instrument = self._instrument
        instrument.telescope.stop(instrument.kernel.now)
        found = _optics.nearest(instrument.targets(), instrument.axis(), FIELD_OF_VIEW_RAD)
        if found is None:
            return Answer(Code.AUT_NO_LOCK)
        instrument.lock.follow(found)
        self._point_at(found)
        self._announce("tracker.lock")
        return DONE


def _after(step: Step, then: Callable[[], Step]) -> Step:
    """`then` follows where `step` ends well."""
    if isinstance(step, Work):
        return Work(step.duration_ns, lambda: _after(step.then(), then))
    return then() if step.code is Code.OK else step


CONTROLLER_MODES = range(8)
WIDEST_RAD = pi


def motion_procedures(instrument: Instrument, aiming: Aiming) -> Procedures:
    """Of this instrument."""
    return {**_aiming(instrument, aiming), **_switches(instrument), **_searches(instrument), **_motors(instrument)}


def _aiming(instrument: Instrument, aiming: Aiming) -> Procedures:
    def position(hz: float, v: float, mode: int, recognise: int, _: int) -> Step:
        among(mode, BOOLEANS)
        return aiming.position(hz, v, recognise=bool(among(recognise, BOOLEANS)))

    def change_face(mode: int, recognise: int, _: int) -> Step:
        among(mode, BOOLEANS)
        return aiming.change_face(recognise=bool(among(recognise, BOOLEANS)))

    def fine_adjust(width: float, height: float, _: int) -> Step:
        return aiming.fine_adjust(_extent(width) / 2, _extent(height) / 2)

    def search_next(way: int, swing: int) -> Step:
        return aiming.search_next(clockwise=among(way, (1, -1)) > 0, swing=bool(among(swing, BOOLEANS)))

    return {
        6021: getter(lambda: (int(instrument.lock_state),)),
        9013: Procedure("", aiming.lock_in),
        9027: Procedure("ddiii", position),
        9028: Procedure("iii", change_face),
        9029: Procedure("ddi", fine_adjust),
        9037: Procedure("ddi", fine_adjust),
        9051: Procedure("ii", search_next),
        9052: Procedure("", aiming.search_window),
    }


def _extent(window: float) -> float:
    """Width or height of a search window, rad. Raises BadParameter."""
    if not 0.0 <= window <= WIDEST_RAD:
        raise BadParameter(window)
    return window


def _switches(instrument: Instrument) -> Procedures:
    held = instrument.configuration

    def set_recognition(on: int) -> None:
        held.set_recognition(bool(among(on, BOOLEANS)))
        _release_lock_where_off(instrument)

    def set_lock(on: int) -> None:
        held.set_lock(bool(among(on, BOOLEANS)))
        _release_lock_where_off(instrument)

    recognition, lock = setter("i", set_recognition), setter("i", set_lock)
    get_recognition, get_lock = getter(lambda: (held.recognition,)), getter(lambda: (held.lock,))
    return {
        9018: recognition,
        9019: get_recognition,
        9020: lock,
        9021: get_lock,
        18005: recognition,
        18006: get_recognition,
        18007: lock,
        18008: get_lock,
    }


def _release_lock_where_off(instrument: Instrument) -> None:
    if not instrument.configuration.lock:
        instrument.lock.release()


def _searches(instrument: Instrument) -> Procedures:
    held = instrument.configuration

    def set_area(hz: float, v: float, range_hz: float, range_v: float, on: int) -> None:
        held.area_on = bool(among(on, BOOLEANS))
        held.area = (hz, v, positive(range_hz), positive(range_v))

    def set_pair(name: str, first: float, second: float) -> None:
        setattr(held, name, (positive(first), positive(second)))

    return {
        9007: setter("dd", lambda hz, v: set_pair("tolerance", hz, v)),
        9008: getter(lambda: held.tolerance),
        9011: setter("dd", lambda hz, v: set_pair("time_out_s", hz, v)),
        9012: getter(lambda: held.time_out_s),
        9040: getter(lambda: held.spiral),
        9041: setter("dd", lambda hz, v: set_pair("spiral", hz, v)),
        9042: getter(lambda: (*held.area, held.area_on)),
        9043: setter("ddddi", set_area),
    }


def _motors(instrument: Instrument) -> Procedures:
    def start(mode: int) -> None:
        among(mode, CONTROLLER_MODES)
        instrument.controller_on = True

    def stop(mode: int) -> None:
        among(mode, BOOLEANS)
        instrument.controller_on = False
        instrument.stop_movement()

    def drive(hz_rate: float, v_rate: float) -> Step:
        if not instrument.controller_on:
            return Answer(Code.MOT_UNREADY)
        instrument.lock.release()
        instrument.meter.clear()
        instrument.telescope.drive(hz_rate, v_rate, instrument.kernel.now)
        return DONE

    return {6001: setter("i", start), 6002: setter("i", stop), 6004: Procedure("dd", drive)}
