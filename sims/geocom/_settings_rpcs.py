"""Procedures that identify the instrument and set it up: COM, CSV, settings of BAP and TMC."""

from __future__ import annotations

from sims.geocom._configuration import EDM_OF_PROGRAM, MODES, USER_PRISM, USER_PRISMS, GeometricPpm, Prism
from sims.geocom._instrument import Instrument, Power
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
    seconds,
    setter,
)

RELEASE = (4, 20, 0)
"""Of the GeoCOM server and of the firmware."""

WAKE_S = 3.0
BOARD_OVER_AIR_C = 9.5
"""The mainboard is warmer than the air."""

SERIAL_FROM = 900_000


def settings_procedures(instrument: Instrument) -> Procedures:
    """Of this instrument."""
    return {**_communication(instrument), **_services(instrument), **_reflector(instrument), **_corrections(instrument)}


def _communication(instrument: Instrument) -> Procedures:
    held = instrument.configuration

    def set_digits(digits: int) -> None:
        held.digits = among(digits, range(16))

    def switch_on(mode: int) -> Step:
        among(mode, BOOLEANS)
        return DONE if instrument.power is Power.ON else Work(seconds(WAKE_S), awake)

    def awake() -> Step:
        instrument.switch(Power.ON)
        return DONE

    def switch_off(mode: int) -> None:
        instrument.switch((Power.OFF, Power.ASLEEP)[among(mode, BOOLEANS)])

    return {
        0: Procedure("", lambda: DONE),
        1: Procedure("", lambda: DONE),
        107: setter("i", set_digits),
        108: getter(lambda: (held.digits,)),
        110: getter(lambda: RELEASE),
        111: Procedure("i", switch_on),
        112: setter("i", switch_off),
    }


def _services(instrument: Instrument) -> Procedures:
    build = instrument.build
    return {
        5003: getter(lambda: (SERIAL_FROM + build.seed % 100_000,)),
        5004: getter(lambda: (f"SIM-{build.profile.model}",)),
        5011: getter(lambda: (float(instrument.sight.air_c() + BOARD_OVER_AIR_C),)),
        5034: getter(lambda: RELEASE),
        5039: getter(lambda: (95, 1, 1)),
    }


def _reflector(instrument: Instrument) -> Procedures:
    held = instrument.configuration
    return {
        17008: setter("i", lambda kind: setattr(held, "prism_type", among(kind, held.prisms))),
        17009: getter(lambda: (held.prism_type,)),
        17018: getter(lambda: (held.program,)),
        17019: setter("i", lambda program: _set_program(instrument, program)),
        17021: setter("i", lambda kind: _set_target_type(instrument, kind)),
        17022: getter(lambda: (held.target_type,)),
        17023: Procedure("i", lambda kind: _prism_answer(held.prisms.get(kind))),
        17024: setter("isdi", lambda kind, *definition: _define(instrument, kind, Prism(*definition))),
        17032: setter("sdis", lambda *definition: _define_user(instrument, *definition)),
        17033: Procedure("s", lambda name: _user_prism_answer(held.user_prisms.get(name))),
        2023: getter(lambda: (held.prisms[held.prism_type].constant_m,)),
        2024: setter("d", lambda constant: _set_constant(instrument, constant)),
    }


def _corrections(instrument: Instrument) -> Procedures:
    held = instrument.configuration

    def set_air(wave_um: float, pressure_hpa: float, dry_c: float, wet_c: float) -> None:
        if not (500 <= pressure_hpa <= 1200 and -40 <= dry_c <= 60 and wet_c <= dry_c and wave_um >= 0):
            raise BadParameter
        held.set_air(wave_um, pressure_hpa, dry_c, wet_c)

    def set_geometric(*values: float) -> None:
        held.geometric = GeometricPpm(int(values[0]), *values[1:])

    def get_geometric() -> tuple[int | float, ...]:
        geo = held.geometric
        return (geo.automatic, geo.scale, geo.offset_m, geo.height_ppm, geo.individual_ppm)

    return {
        2006: setter("i", lambda on: setattr(held, "compensator", bool(among(on, BOOLEANS)))),
        2007: getter(lambda: (held.compensator,)),
        2009: getter(lambda: held.station),
        2010: setter("dddd", lambda *place: setattr(held, "station", place)),
        2020: setter("i", lambda mode: setattr(held, "edm_mode", among(mode, MODES))),
        2021: getter(lambda: (held.edm_mode,)),
        2028: setter("dddd", set_air),
        2029: getter(lambda: (held.wave_um, held.pressure_hpa, held.dry_c, held.wet_c)),
        2113: setter("d", instrument.orient),
        2148: setter("d", lambda ppm: setattr(held, "atmospheric_ppm", ppm)),
        2151: getter(lambda: (held.atmospheric_ppm,)),
        2153: setter("idddd", set_geometric),
        2154: getter(get_geometric),
    }


def _set_program(instrument: Instrument, program: int) -> None:
    held = instrument.configuration
    held.edm_mode = EDM_OF_PROGRAM[among(program, EDM_OF_PROGRAM)]
    held.program = program


def _set_target_type(instrument: Instrument, kind: int) -> None:
    instrument.configuration.target_type = among(kind, BOOLEANS)


def _define(instrument: Instrument, kind: int, prism: Prism) -> None:
    among(kind, USER_PRISMS)
    among(prism.kind, range(3))
    instrument.configuration.prisms[kind] = prism


def _define_user(instrument: Instrument, name: str, constant_m: float, kind: int, creator: str) -> None:
    """A definition by name is that of the type "user" as well."""
    prism = Prism(name, constant_m, among(kind, range(3)), creator)
    instrument.configuration.user_prisms[name] = prism
    instrument.configuration.prisms[USER_PRISM] = prism


def _set_constant(instrument: Instrument, constant_m: float) -> None:
    """Of the prism in use where a person defines it; else the type becomes "user"."""
    held = instrument.configuration
    if held.prism_type not in USER_PRISMS:
        held.prism_type = USER_PRISM
    held.prisms[held.prism_type] = Prism(held.prisms[held.prism_type].name, constant_m)


def _prism_answer(prism: Prism | None) -> Step:
    if prism is None:
        return Answer(Code.IVPARAM)
    return Answer(values=(prism.name, prism.constant_m, prism.kind))


def _user_prism_answer(prism: Prism | None) -> Step:
    if prism is None:
        return Answer(Code.IVPARAM)
    return Answer(values=(prism.constant_m, prism.kind, prism.creator))
