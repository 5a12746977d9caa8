"""GeoCOM on the instrument's side: lines, return codes, answers, and the table of remote procedures.

Requests: `%R1Q,RPC[,TrId[,CRC]]:P0,P1…`. Replies: `%R1P,RC_COM,TrId[,CRC]:RC,P0,P1…`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, final

TERMINATOR = b"\r\n"
LONGEST = 512
"""Characters that the receive buffer holds, requests that wait included."""

MOST_RPC = 65_535

_REQUEST = re.compile(r"%R1Q,([0-9]{1,5})(?:,([0-9]{1,10}))?(?:,([0-9]{1,5}))?:(.*)")
_PARAMETER = re.compile(r'\s*("(?:[^"\\]|\\.)*"|\'[^\']*\'|[^,"\']*)\s*(,|$)')
_ESCAPE = re.compile(r"\\(x[0-9A-Fa-f]{2}|.)")

Value = int | float | str | bool


class WrongFormat(ValueError):
    """The line is no request."""


class WrongChecksum(ValueError):
    """The checksum is not that of the line."""


@final
@dataclass(frozen=True, slots=True)
class Request:
    """A request of the host. parameters: as written. transaction: its TrId, 0 without one. checked: it had a CRC."""

    rpc: int
    parameters: tuple[str, ...]
    transaction: int = 0
    checked: bool = False


def crc16(data: bytes) -> int:
    """CRC-16/ARC (polynomial 0xA001 reflected, initial value 0); 0xBB3D of b"123456789"."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0xA001 if crc & 1 else 0)
    return crc


def parse_request(line: bytes) -> Request:
    """A line without its end. Raises WrongFormat, WrongChecksum."""
    found = _REQUEST.fullmatch(line.decode("latin-1"))
    if found is None or int(found[1]) > MOST_RPC:
        raise WrongFormat
    rpc, transaction, check, text = found.groups()
    if check is not None and int(check) != crc16(f"%R1Q,{rpc},{transaction}:{text}".encode("latin-1")):
        raise WrongChecksum
    return Request(int(rpc), _split(text), int(transaction or 0), check is not None)


def _split(text: str) -> tuple[str, ...]:
    """The parameters of a request; commas within quotes are part of them. Raises WrongFormat."""
    if not text:
        return ()
    found: list[str] = []
    place = 0
    while True:
        part = _PARAMETER.match(text, place)
        if part is None:
            raise WrongFormat
        found.append(part[1].strip())
        place = part.end()
        if not part[2]:
            return tuple(found)


def reply(transaction: int, parts: Iterable[str], *, com: int = 0, checked: bool = False) -> bytes:
    """A reply with its end. com: RC_COM; parts: RC and the values, as written."""
    tail = ",".join(parts)
    head = f"%R1P,{com},{transaction}"
    if checked:
        head += f",{crc16(f'{head}:{tail}'.encode('ascii'))}"
    return f"{head}:{tail}".encode("ascii") + TERMINATOR


def written(value: Value, digits: int) -> str:
    """A value as the instrument writes it; `digits`: decimals of a double."""
    if isinstance(value, str):
        return f'"{"".join(map(_escaped, value))}"'
    if isinstance(value, float):
        return f"{value:.{digits}f}"
    return str(int(value))


def _escaped(character: str) -> str:
    if character in '"\\~%':
        return f"\\{character}"
    return character if " " <= character <= "~" else f"\\x{ord(character):02X}"


def read_whole(text: str) -> int:
    """An integer, `12` or `0xC`. Raises ValueError."""
    return int(text, 16 if text.lower().startswith("0x") else 10)


def read_double(text: str) -> float:
    """A finite double. Raises ValueError."""
    value = float(text)
    if value != value or value in (float("inf"), float("-inf")):
        raise ValueError(text)
    return value


def read_string(text: str) -> str:
    """A string in quotes. Raises ValueError."""
    if len(text) < 2 or text[0] != '"' or text[-1] != '"':
        raise ValueError(text)
    return _ESCAPE.sub(lambda found: chr(int(found[1][1:], 16)) if len(found[1]) == 3 else found[1], text[1:-1])


class Code(IntEnum):
    """Of an RPC (`RC`), and from 3077 to 3110 of the transport (`RC_COM`)."""

    OK = 0
    IVPARAM = 2
    SYSBUSY = 13
    INSTRUMENT_TILT = 22
    NA = 27
    EDM_FLUKT = 776
    EDM_BUSY = 786
    EDM_DISTRANGE = 818
    EDM_DIST_TOO_SHORT = 829
    TMC_NO_FULL_CORRECTION = 1283
    TMC_ACCURACY_GUARANTEE = 1284
    TMC_ANGLE_OK = 1285
    TMC_ANGLE_NO_FULL_CORRECTION = 1288
    TMC_DIST_ERROR = 1292
    TMC_BUSY = 1293
    MOT_UNREADY = 1792
    MOT_BUSY = 1793
    COM_WRONG_FORMAT = 3078
    COM_PROC_UNAVAIL = 3081
    COM_OVERRUN = 3100
    COM_SRVR_RX_CHECKSUM_ERR = 3101
    COM_SRVR_IS_SLEEPING = 3108
    COM_SRVR_IS_OFF = 3109
    AUT_TIMEOUT = 8704
    AUT_NO_TARGET = 8710
    AUT_MULTIPLE_TARGETS = 8711
    AUT_NOT_ENABLED = 8714
    AUT_NO_WORKING_AREA = 8720
    AUT_NO_LOCK = 8725


CARRY_DATA = frozenset(
    {
        Code.OK,
        Code.TMC_NO_FULL_CORRECTION,
        Code.TMC_ACCURACY_GUARANTEE,
        Code.TMC_ANGLE_OK,
        Code.TMC_ANGLE_NO_FULL_CORRECTION,
    }
)
"""The codes whose reply has parameters; every other reply ends with its code."""


@final
@dataclass(frozen=True, slots=True)
class Answer:
    """RC and the parameters. A code that carries no data has none."""

    code: Code = Code.OK
    values: tuple[Value, ...] = ()

    def __post_init__(self) -> None:
        if self.code not in CARRY_DATA:
            object.__setattr__(self, "values", ())


@final
@dataclass(frozen=True, slots=True)
class Work:
    """Busy for `duration_ns`; `then` gives what comes next."""

    duration_ns: int
    then: Callable[[], Step]


Step = Answer | Work
DONE = Answer()


def seconds(value: float) -> int:
    """As nanoseconds."""
    return round(value * 1e9)


READERS: dict[str, Callable[[str], Value]] = {"i": read_whole, "d": read_double, "s": read_string}
"""By letter: whole number, double, string."""

BOOLEANS = (0, 1)


class BadParameter(ValueError):
    """A parameter's value that the procedure does not take."""


@final
@dataclass(frozen=True, slots=True)
class Procedure:
    """One RPC. types: a letter of `READERS` for each parameter, as "ddi"."""

    types: str
    action: Callable[..., Step]

    def call(self, parameters: Sequence[str]) -> Step:
        """Do it. Code IVPARAM where number, type or value of the parameters is wrong."""
        if len(parameters) != len(self.types):
            return Answer(Code.IVPARAM)
        try:
            return self.action(*(READERS[kind](text) for kind, text in zip(self.types, parameters, strict=True)))
        except ValueError:
            return Answer(Code.IVPARAM)


Procedures = Mapping[int, Procedure]


def setter(types: str, action: Callable[..., object]) -> Procedure:
    """A procedure that sets something at once and answers with its code alone."""

    def do(*values: Any) -> Step:
        action(*values)
        return DONE

    return Procedure(types, do)


def getter(values: Callable[[], Iterable[Value]]) -> Procedure:
    """A procedure without parameters that answers at once."""
    return Procedure("", lambda: Answer(values=tuple(values())))


def among(value: int, possible: Iterable[int]) -> int:
    """The value. Raises BadParameter where it is not one of those."""
    if value not in possible:
        raise BadParameter(value)
    return value


def positive(value: float) -> float:
    """The value. Raises BadParameter where it is not above 0."""
    if value <= 0.0:
        raise BadParameter(value)
    return value
