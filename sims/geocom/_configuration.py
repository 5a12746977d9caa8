"""What can be set on the instrument, with the values that it has when it is switched on."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import radians
from typing import final

from sims.geocom import _optics

USER_PRISM = 9
USER_PRISMS = (4, 5, 6, USER_PRISM)
"""Prism types whose constant a person defines; type 9 is the one that BAP_SetUserPrismDef defines."""

PRISM_NAMES = {
    0: "Leica Circ Prism",
    1: "Leica Mini Prism",
    2: "Leica Tape",
    3: "Leica 360 Prism",
    7: "Leica Mini 360",
    8: "Leica Mini Zero",
    10: "Leica HDS Target",
    11: "Leica GRZ121",
    12: "Leica MPR122",
}
PRISM_CONSTANTS_M = {0: 0.0, 1: 0.0175, 2: 0.0344, 3: 0.0231, 7: 0.0300, 8: 0.0, 10: 0.0344, 11: 0.0231, 12: 0.0281}
"""Additive constants, m, relative to the round prism (Leica prism table)."""

EDM_OF_PROGRAM = {0: 2, 1: 3, 2: 4, 3: 6, 4: 6, 5: 9, 6: 8, 7: 10, 8: 12, 9: 11, 10: 7, 11: 13}
"""Measuring program → distance meter's mode (numbers of TPS1200 firmware)."""

SECONDS_OF_MODE = {2: 1.0, 3: 0.5, 4: 2.5, 10: 3.0, 13: 2.0}
"""How long one distance takes in the modes that use a reflector, of a standard measurement of 1 s."""

TRACKING_MODES = frozenset({6, 7, 9})
TRACKING_SECONDS = 0.3
REFLECTORLESS_MODES = frozenset({5, 8, 11, 12})
MODES = range(1, 15)


@final
@dataclass(frozen=True, slots=True)
class Prism:
    """A reflector's definition. constant_m: added to a distance; kind: 0 undefined, 1 prism, 2 tape."""

    name: str
    constant_m: float
    kind: int = 1
    creator: str = ""


@final
@dataclass(frozen=True, slots=True)
class GeometricPpm:
    """Corrections of a distance other than the air's: TMC_SetGeoPpm."""

    automatic: int = 0
    scale: float = 1.0
    offset_m: float = 0.0
    height_ppm: float = 0.0
    individual_ppm: float = 0.0

    @property
    def ppm(self) -> float:
        """All of it."""
        return (self.scale - 1.0) * 1e6 + self.height_ppm + self.individual_ppm


@final
@dataclass(slots=True)
class Configuration:
    """The settings. Angles in rad, lengths in m, as on the line."""

    prism_type: int = 0
    prisms: dict[int, Prism] = field(
        default_factory=lambda: {
            **{kind: Prism(PRISM_NAMES[kind], constant) for kind, constant in PRISM_CONSTANTS_M.items()},
            **{kind: Prism("", 0.0, 0) for kind in USER_PRISMS},
        }
    )
    user_prisms: dict[str, Prism] = field(default_factory=dict)
    target_type: int = 0
    program: int = 0
    edm_mode: int = 2
    recognition: bool = False
    lock: bool = False
    compensator: bool = True
    wave_um: float = 0.658
    pressure_hpa: float = 1013.25
    dry_c: float = 12.0
    wet_c: float = 8.2
    atmospheric_ppm: float = 0.0
    geometric: GeometricPpm = field(default_factory=GeometricPpm)
    digits: int = 15
    tolerance: tuple[float, float] = (radians(0.002), radians(0.002))
    time_out_s: tuple[float, float] = (10.0, 10.0)
    spiral: tuple[float, float] = (radians(4.0), radians(4.0))
    area: tuple[float, float, float, float] = (0.0, radians(90), radians(30), radians(30))
    area_on: bool = False
    station: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    orientation: float = 0.0

    @property
    def constant_mm(self) -> float:
        """Of the prism in use."""
        return self.prisms[self.prism_type].constant_m * 1e3

    @property
    def ppm(self) -> float:
        """By which every distance is corrected."""
        return self.atmospheric_ppm + self.geometric.ppm

    def set_air(self, wave_um: float, pressure_hpa: float, dry_c: float, wet_c: float) -> None:
        """As TMC_SetAtmCorr: from here on the distances are corrected by it."""
        self.wave_um, self.pressure_hpa, self.dry_c, self.wet_c = wave_um, pressure_hpa, dry_c, wet_c
        self.atmospheric_ppm = _optics.ppm_of_air(
            dry_c, pressure_hpa, _optics.vapour_of_wet_bulb(dry_c, wet_c, pressure_hpa)
        )

    def set_recognition(self, on: bool) -> None:
        """Automatic target recognition; without it there is no lock."""
        self.recognition, self.lock = on, self.lock and on

    def set_lock(self, on: bool) -> None:
        """Lock mode; it needs target recognition and switches it on."""
        self.lock, self.recognition = on, self.recognition or on

    def measuring_seconds(self, standard_s: float) -> float:
        """One distance in the present mode. standard_s: in standard mode."""
        if self.edm_mode in TRACKING_MODES:
            return TRACKING_SECONDS * standard_s
        return SECONDS_OF_MODE.get(self.edm_mode, 1.0) * standard_s
