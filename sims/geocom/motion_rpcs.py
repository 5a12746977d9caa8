"""Procedures that move the telescope: AUT, the switches of target recognition and lock (AUT, AUS), MOT."""

from __future__ import annotations

from math import pi

from sims.geocom.aiming import Aiming
from sims.geocom.codes import Code
from sims.geocom.instrument import Instrument
from sims.geocom.procedures import BOOLEANS, BadParameter, Procedure, Procedures, among, getter, positive, setter
from sims.geocom.work import DONE, Answer, Step

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
