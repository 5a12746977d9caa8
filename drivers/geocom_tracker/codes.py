"""GeoCOM's return codes, mapped to what a caller can do. Source: the GeoCOM reference manuals and geocompy's list."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, final

from geocompy.geo.gctypes import GeoComCode

from cellctl.devices import (
    DeviceBusy,
    DeviceError,
    DeviceFault,
    DeviceLost,
    DeviceRefused,
    NotLevelled,
    OutOfRange,
    TargetLost,
)


class Meaning(Enum):
    """What a return code means for its request."""

    DONE = auto()
    WARNING = auto()
    """All the data are there; their accuracy is not guaranteed."""
    ANGLES_ONLY = auto()
    """The angles are there, the distance is not."""
    NO_TARGET = auto()
    OUT_OF_RANGE = auto()
    BUSY = auto()
    """Not executed; the same request can succeed soon."""
    ASLEEP = auto()
    """Not executed; the instrument must be switched on."""
    TILTED = auto()
    REFUSED = auto()
    FAULT = auto()
    ENDING = auto()
    """The instrument is switching off."""
    NOT_HEARD = auto()
    """The request was spoilt on the line and not executed: it can be repeated, a motion too."""
    ANSWER_LOST = auto()
    """No answer that can be used: the request may have been executed."""


@final
@dataclass(frozen=True, slots=True)
class Code:
    """A return code's meaning, in words, with the cure."""

    meaning: Meaning
    what: str
    cure: str = ""


_AIM = "check that nothing is between instrument and reflector, then aim again"
_LIGHT = "shade the reflector from lamps and sun, clean it, then aim again"
_RANGE = "turn the reflector towards the instrument, or choose another pose or station"
_SERVICE = "switch the instrument off and on; if it stays, have it serviced"
_TURN = "check that the telescope turns freely; then initialise and aim again"
_LATER = "wait until it has ended its work, then ask again"
_POWER = "connect the external supply or change the battery"
_LINE = "check cable, baud rate and interference on the serial line"
_TYPE = "check the instrument's type, firmware and GeoCOM licence"
_SWITCH_ON = "switch the instrument on, and switch off its automatic sleep"
_LEVEL = "level the instrument; its compensator works within a few arc minutes"
_PROGRAM = "initialise it; no other program may change its settings meanwhile"

CODES: Final[dict[int, Code]] = {
    0: Code(Meaning.DONE, "done"),
    1: Code(Meaning.FAULT, "reports an undefined error", _SERVICE),
    2: Code(Meaning.REFUSED, "refuses a parameter", _TYPE),
    3: Code(Meaning.REFUSED, "has no valid result", _AIM),
    4: Code(Meaning.FAULT, "reports a fatal error", _SERVICE),
    5: Code(Meaning.REFUSED, "does not have this function", _TYPE),
    6: Code(Meaning.FAULT, "did not end its function in time", _TURN),
    8: Code(Meaning.REFUSED, "was interrupted at the instrument", "leave its keys alone; ask again"),
    12: Code(Meaning.ENDING, "is switching off", _SWITCH_ON),
    13: Code(Meaning.BUSY, "is busy", _LATER),
    14: Code(Meaning.FAULT, "reports a hardware fault", _SERVICE),
    16: Code(Meaning.FAULT, "has too little power", _POWER),
    18: Code(Meaning.FAULT, "has an empty battery", _POWER),
    21: Code(Meaning.FAULT, "is outside its working temperature", "let it reach the temperature of the room"),
    22: Code(Meaning.TILTED, "is tilted", _LEVEL),
    23: Code(Meaning.REFUSED, "has unsuitable communication settings", "set RS-232 to 115200 8N1 and GeoCOM"),
    24: Code(Meaning.REFUSED, "has no action to end", _LATER),
    25: Code(Meaning.ASLEEP, "is asleep", _SWITCH_ON),
    26: Code(Meaning.REFUSED, "did not do it", _PROGRAM),
    27: Code(Meaning.REFUSED, "has no licence for this function", _TYPE),
    770: Code(Meaning.NO_TARGET, "receives no light from the reflector", _AIM),
    775: Code(Meaning.NO_TARGET, "measured no distance in time", _AIM),
    776: Code(Meaning.NO_TARGET, "receives unstable light", _AIM),
    786: Code(Meaning.BUSY, "is measuring a distance", _LATER),
    818: Code(Meaning.OUT_OF_RANGE, "cannot measure this distance", _RANGE),
    819: Code(Meaning.OUT_OF_RANGE, "receives too little light for a distance", _RANGE),
    823: Code(Meaning.NO_TARGET, "receives light from several reflectors", "cover the others, then aim again"),
    829: Code(Meaning.OUT_OF_RANGE, "is too near to the reflector", _RANGE),
    1283: Code(Meaning.WARNING, "not all corrections are applied (1283)", _LEVEL),
    1284: Code(Meaning.WARNING, "the accuracy is not guaranteed (1284)", _AIM),
    1285: Code(Meaning.ANGLES_ONLY, "measured angles and no distance", _AIM),
    1288: Code(Meaning.ANGLES_ONLY, "measured angles without all corrections, and no distance", _AIM),
    1289: Code(Meaning.ANGLES_ONLY, "measured angles of uncertain accuracy, and no distance", _AIM),
    1290: Code(Meaning.FAULT, "cannot measure angles or inclination", _LEVEL),
    1291: Code(Meaning.REFUSED, "has wrong settings of its distance meter", _PROGRAM),
    1292: Code(Meaning.NO_TARGET, "found no target for a distance", _AIM),
    1293: Code(Meaning.BUSY, "is measuring", _LATER),
    1294: Code(Meaning.NO_TARGET, "receives no usable signal", _AIM),
    1792: Code(Meaning.BUSY, "is not ready to turn", _LATER),
    1793: Code(Meaning.BUSY, "is turning", _LATER),
    1799: Code(Meaning.NO_TARGET, "is not locked onto the reflector", _AIM),
    1804: Code(Meaning.FAULT, "reports an error of its horizontal motor", _TURN),
    1805: Code(Meaning.FAULT, "reports an error of its vertical motor", _TURN),
    1806: Code(Meaning.FAULT, "did not reach its direction in time", _TURN),
    1807: Code(Meaning.FAULT, "did not reach its horizontal direction in time", _TURN),
    1808: Code(Meaning.FAULT, "did not reach its vertical direction in time", _TURN),
    3074: Code(Meaning.ANSWER_LOST, "gave an unreadable answer", _LINE),
    3075: Code(Meaning.ANSWER_LOST, "cannot be written to", _LINE),
    3077: Code(Meaning.ANSWER_LOST, "did not answer in time", _LINE),
    3078: Code(Meaning.NOT_HEARD, "received a request of wrong format", _LINE),
    3081: Code(Meaning.REFUSED, "does not have this procedure", _TYPE),
    3085: Code(Meaning.ANSWER_LOST, "could not be asked", _LINE),
    3093: Code(Meaning.ANSWER_LOST, "answered with another transaction number", _LINE),
    3094: Code(Meaning.NOT_HEARD, "received no GeoCOM request", _LINE),
    3100: Code(Meaning.NOT_HEARD, "lost characters of the request", _LINE),
    3101: Code(Meaning.NOT_HEARD, "received a request with a wrong check sum", _LINE),
    3102: Code(Meaning.ANSWER_LOST, "gave an answer with a wrong check sum", _LINE),
    3108: Code(Meaning.ASLEEP, "is asleep", _SWITCH_ON),
    3109: Code(Meaning.ASLEEP, "is switched off", _SWITCH_ON),
    3110: Code(Meaning.REFUSED, "does not take check sums", "load firmware whose GeoCOM has check sums"),
    8704: Code(Meaning.NO_TARGET, "did not reach its direction or its target in time", _AIM),
    8705: Code(Meaning.FAULT, "was stopped by an obstacle", _TURN),
    8706: Code(Meaning.FAULT, "cannot measure its angles", _SERVICE),
    8707: Code(Meaning.FAULT, "reports an error of its motors", _TURN),
    8708: Code(Meaning.NO_TARGET, "reached its direction only roughly", _AIM),
    8709: Code(Meaning.NO_TARGET, "cannot measure the deviation of the reflector", _AIM),
    8710: Code(Meaning.NO_TARGET, "found no reflector", _AIM),
    8711: Code(Meaning.NO_TARGET, "found several reflectors", "cover the others or search a smaller window"),
    8712: Code(Meaning.NO_TARGET, "is disturbed by other light", _LIGHT),
    8713: Code(Meaning.FAULT, "reports an error of its target detector", _SERVICE),
    8714: Code(Meaning.REFUSED, "has target recognition switched off", _PROGRAM),
    8716: Code(Meaning.NO_TARGET, "cannot point accurately enough", _LIGHT),
    8720: Code(Meaning.REFUSED, "has no working area", _PROGRAM),
    8723: Code(Meaning.FAULT, "has an open side cover", "close its side cover"),
    8725: Code(Meaning.NO_TARGET, "cannot lock onto the reflector", _AIM),
}

_ERRORS: Final[dict[Meaning, type[DeviceError]]] = {
    Meaning.ANGLES_ONLY: TargetLost,
    Meaning.NO_TARGET: TargetLost,
    Meaning.OUT_OF_RANGE: OutOfRange,
    Meaning.BUSY: DeviceBusy,
    Meaning.ASLEEP: DeviceFault,
    Meaning.TILTED: NotLevelled,
    Meaning.REFUSED: DeviceRefused,
    Meaning.FAULT: DeviceFault,
    Meaning.ENDING: DeviceLost,
    Meaning.NOT_HEARD: DeviceLost,
    Meaning.ANSWER_LOST: DeviceLost,
}


def code_of(number: int) -> Code:
    """The meaning of a return code; one that is not listed is a fault that names it."""
    listed = CODES.get(number)
    if listed:
        return listed
    name = next((code.name for code in GeoComCode if code == number), "unknown")
    return Code(Meaning.FAULT, f"reports {name}", _SERVICE)


def error_of(device: str, number: int, request: str = "") -> DeviceError:
    """The error that a return code is for a caller. `request`: name of the procedure, `AUT_FineAdjust`."""
    code = code_of(number)
    where = f"return code {number}" + (f" of {request}" if request else "")
    return _ERRORS.get(code.meaning, DeviceFault)(device, f"{code.what} ({where})", code.cure)
