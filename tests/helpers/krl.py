"""Runs KRL programs: as much of the language as the controller's programs use, with whole numbers of 32 bits.

An interpreter and no translation of what it runs: it reads the files that a person loads. Motion, interrupts and the
system's variables are whatever the test puts there.

A `Seam` is a KUKA program and its data list as a pendant writes them, around the KR5 of `kr5_model`. The points are
computed here from joint readings by the nominal robot; bases and tools are those of `$config.dat`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from cellctl.formats import RobotFile
from cellctl.kinematics import Floats, abc_from_rotation, inverse, inverse_pose, pose_from_xyz_abc
from cellctl.kinematics.controller_readings import status_of, turn_of
from tests.helpers.arms import KR5_FILE

Builtin = Callable[..., Any]
_TOKEN = re.compile(
    r"""\s*(?:(?P<text>"[^"]*")|(?P<number>\d+\.\d+|\d+)|(?P<enum>\#\w+)|(?P<name>\$?[A-Za-z_]\w*)"""
    r"""|(?P<sign><=|>=|<>|==|[-+*/<>=(),.\[\]]))"""
)
_LEVELS = [{"OR", "EXOR"}, {"AND"}, {"==", "<>", "<", ">", "<=", ">="}, {"B_OR", "B_EXOR"}, {"B_AND"}, {"+", "-"}]
_BLOCKS = {"IF": "ENDIF", "FOR": "ENDFOR", "SWITCH": "ENDSWITCH", "LOOP": "ENDLOOP"}

FILE = RobotFile.load(KR5_FILE)
CHAIN, JOINTS = FILE.chain(), FILE.joint_map()
TORCH = (*FILE.tool.xyz, *FILE.tool.abc)
TABLE = (900.0, -100.0, 200.0, 10.0, 5.0, -3.0)
BASE = pose_from_xyz_abc(TABLE[:3], TABLE[3:])
CORNER = np.array([-8.0, -55.0, 78.0, 14.0, 55.0, 25.0])
"""Readings of the first point, in the region of `kr5_model`."""


class Return(Exception):
    """A RETURN with its value."""

    def __init__(self, value: Any) -> None:
        self.value = value


class Text(list[int]):
    """A CHAR array: codes, up to the first zero."""

    def __str__(self) -> str:
        return "".join(map(chr, self))


@dataclass
class Place:
    """Where a value is kept: a mapping and a key."""

    store: Any
    key: Any

    def get(self) -> Any:
        return self.store[self.key]

    def set(self, value: Any) -> None:
        self.store[self.key] = value


@dataclass
class Parameter:
    """A parameter: `goes_back` (OUT); `array`: with brackets in the header, as an array has to be declared there."""

    name: str
    goes_back: bool
    array: bool


@dataclass
class Routine:
    """A DEF or DEFFCT: its parameters and its lines."""

    name: str
    parameters: list[Parameter]
    lines: list[str]

    def check_arrays(self) -> None:
        """The arrays among the parameters are the same in the header and in the declarations."""
        declared = {name for line in self.lines for name in re.findall(r"^DECL \w+ (\w+)\[\]$", line)}
        in_header = {parameter.name for parameter in self.parameters if parameter.array}
        assert in_header == declared, f"{self.name}: arrays in the header {in_header}, declared {declared}"


def whole(value: int) -> int:
    """`value` as 32 bits with a sign."""
    return (value + 2**31) % 2**32 - 2**31


class Krl:
    """Loaded programs and data. `variables` are by upper-case name; arrays are dicts by index tuple, from 1."""

    def __init__(self, sources: list[str], builtins: dict[str, Builtin]) -> None:
        self.variables: dict[str, Any] = {}
        self.routines: dict[str, Routine] = {}
        self.builtins = {name.upper(): builtin for name, builtin in builtins.items()}
        self.on_statement: Callable[[], None] = lambda: None
        for source in sources:
            self._load(source)

    def call(self, name: str, *arguments: Any) -> Any:
        """Run a routine with plain values."""
        return self._run(name.upper(), [Place([value], 0) for value in arguments])

    # loading

    def _load(self, source: str) -> None:
        routine: list[str] | None = None
        for line in source.splitlines():
            text = re.sub(r"^\s*;.*", "", line).strip()
            if not text or text.startswith("&"):
                continue
            head = re.match(r"(?:GLOBAL )?(?:DEF|DEFFCT \w+) (\w+)\(([^)]*)\)$", text)
            if head:
                routine = []
                loaded = Routine(head[1], _parameters(head[2]), routine)
                self.routines[head[1].upper()] = loaded
            elif routine is not None:
                if text in ("END", "ENDFCT"):
                    loaded.check_arrays()
                    routine = None
                else:
                    routine.append(text)
            else:
                self._data(text)

    def _data(self, text: str) -> None:
        found = re.match(r"DECL GLOBAL (?:CONST )?(\w+) (\w+)(\[[\d,]*\])?(?:=(.*))?$", text)
        if not found:
            return
        kind, name, size, value = found.groups()
        if size:
            self.variables[name] = Text() if kind == "CHAR" else {}
            if kind == "CC_BANK_T":
                banks = range(1, int(size[1:-1]) + 1)
                self.variables[name] = {(n,): {"ID": Text(), "SUM": Text(), "ROWS": 0, "TAKEN": 0} for n in banks}
        elif value and value.startswith("{"):
            self.variables[name] = {axis: float(v) for axis, v in re.findall(r"(A\d) (-?[\d.]+)", value)}
        else:
            self.variables[name] = {"TRUE": True, "FALSE": False}.get(value or "0", value)
            if isinstance(self.variables[name], str):
                self.variables[name] = int(value)

    # running

    def _run(self, name: str, arguments: list[Place]) -> Any:
        if name in self.builtins:
            return self.builtins[name](*arguments)
        routine = self.routines[name]
        local: dict[str, Any] = {}
        for parameter, place in zip(routine.parameters, arguments, strict=True):
            assert _is_text(place.get()) == parameter.array, f"{name}: {parameter.name} is no such kind"
            local[parameter.name] = Ref(place) if parameter.goes_back else _copy(place.get())
        try:
            self._block(routine.lines, 0, len(routine.lines), local)
        except Return as end:
            return end.value
        return None

    def _block(self, lines: list[str], at: int, end: int, local: dict[str, Any]) -> None:
        while at < end:
            self.on_statement()
            word = lines[at].split("(")[0].split(" ")[0]
            if word in _BLOCKS:
                close = _closing(lines, at, word, _BLOCKS[word])
                getattr(self, f"_{word.lower()}")(lines, at, close, local)
                at = close + 1
            else:
                self._statement(lines[at], local)
                at += 1

    def _if(self, lines: list[str], at: int, close: int, local: dict[str, Any]) -> None:
        middle = next((n for n in range(at + 1, close) if lines[n] == "ELSE" and _depth(lines, at, n) == 1), close)
        condition = lines[at].removeprefix("IF ").removesuffix(" THEN")
        if self.value(condition, local):
            self._block(lines, at + 1, middle, local)
        else:
            self._block(lines, middle + 1, close, local)

    def _for(self, lines: list[str], at: int, close: int, local: dict[str, Any]) -> None:
        head = re.fullmatch(r"FOR (\w+)=(.+) TO (.+?)(?: STEP (.+))?", lines[at])
        assert head, lines[at]
        step = self.value(head[4], local) if head[4] else 1
        first, last = self.value(head[2], local), self.value(head[3], local)
        for number in range(first, last + (1 if step > 0 else -1), step):
            local[head[1]] = number
            self._block(lines, at + 1, close, local)

    def _switch(self, lines: list[str], at: int, close: int, local: dict[str, Any]) -> None:
        value = self.value(lines[at].removeprefix("SWITCH "), local)
        heads = [n for n in range(at + 1, close) if re.match(r"CASE |DEFAULT$", lines[n])]
        for head, after in zip(heads, [*heads[1:], close], strict=True):
            if lines[head] == "DEFAULT" or self.value(lines[head].removeprefix("CASE "), local) == value:
                self._block(lines, head + 1, after, local)
                return

    def _statement(self, line: str, local: dict[str, Any]) -> None:
        if line.startswith("DECL "):
            _, kind, names = line.split(" ", 2)
            for name, size in re.findall(r"(\w+)(\[\d*\])?", names):
                local.setdefault(name, _fresh(kind, size))
        elif line == "RETURN" or line.startswith("RETURN "):
            raise Return(self.value(line[7:], local) if line[7:] else None)
        elif line.startswith(("WAIT ", "CONFIRM ")):
            self.builtins[line.split(" ")[0]](line)
        elif _is_assignment(line):
            left, right = _is_assignment(line) or ("", "")
            self._assign(left, self.value(right, local), local)
        else:
            self.value(line, local)

    def _assign(self, left: str, value: Any, local: dict[str, Any]) -> None:
        reader = Reader(self, left.replace("[]", ""), local)
        place = reader.place()
        old = place.get() if _has(place) else None
        if isinstance(old, Text) and isinstance(value, str | Text):
            old[:] = _text(value)
            return
        if isinstance(value, float) and isinstance(old, int) and not isinstance(old, bool):
            value = round(value)
        place.set(_copy(value))

    def value(self, expression: str, local: dict[str, Any]) -> Any:
        """What an expression comes to."""
        return Reader(self, expression, local).whole_value()


class Ref:
    """A parameter that goes back to its caller."""

    def __init__(self, place: Place) -> None:
        self.place = place


class Reader:
    """Evaluates one expression as it reads it."""

    def __init__(self, krl: Krl, text: str, local: dict[str, Any]) -> None:
        self._krl = krl
        self._local = local
        self._tokens = _tokens(text)
        self._at = 0

    def whole_value(self) -> Any:
        value = self._level(0)
        assert self._at == len(self._tokens), f"left over: {self._tokens[self._at :]}"
        return value

    def _peek(self) -> str:
        return self._tokens[self._at] if self._at < len(self._tokens) else ""

    def _next(self, expected: str = "") -> str:
        token = self._peek()
        assert not expected or token == expected, f"{expected} expected, {token} found in {self._tokens}"
        self._at += 1
        return token

    def _level(self, level: int) -> Any:
        if level == len(_LEVELS):
            return self._product()
        value = self._level(level + 1)
        while self._peek() in _LEVELS[level]:
            value = _operate(self._next(), value, self._level(level + 1))
        return value

    def _product(self) -> Any:
        value = self._unary()
        while self._peek() in ("*", "/"):
            value = _operate(self._next(), value, self._unary())
        return value

    def _unary(self) -> Any:
        token = self._peek()
        if token == "NOT":
            self._next()
            return not self._unary()
        if token == "B_NOT":
            self._next()
            return whole(~self._unary())
        if token == "-":
            self._next()
            return -self._unary()
        if token == "(":
            self._next()
            value = self._level(0)
            self._next(")")
            return value
        return self._atom()

    def _atom(self) -> Any:
        token = self._peek()
        if token[0] in '"#' or token[0].isdigit():
            self._next()
            if token[0] == '"':
                return token[1:-1]
            return token if token[0] == "#" else float(token) if "." in token else int(token)
        if token in ("TRUE", "FALSE"):
            self._next()
            return token == "TRUE"
        if self._at + 1 < len(self._tokens) and self._tokens[self._at + 1] == "(":
            return self._call()
        return self.place().get()

    def _call(self) -> Any:
        name = self._next().upper()
        self._next("(")
        arguments = []
        while self._peek() != ")":
            arguments.append(self._argument())
            if self._peek() == ",":
                self._next()
        self._next(")")
        return self._krl._run(name, arguments)

    def _argument(self) -> Place:
        """A place where the argument is one by itself, so that it can go back; a value in a place of its own else."""
        mark = self._at
        if re.match(r"\$?[A-Za-z_]", self._peek()) and self._peek() not in ("TRUE", "FALSE", "NOT", "B_NOT"):
            place = None if self._tokens[self._at + 1] == "(" else self.place()
            if place and self._peek() in (",", ")"):
                return place
        self._at = mark
        return Place([self._level(0)], 0)

    def place(self) -> Place:
        """The variable, element or field at the current token."""
        name = self._next().upper()
        store = self._local if name in self._local else self._krl.variables
        place = Place(store, name)
        if name in self._local and isinstance(store[name], Ref):
            place = store[name].place
        while self._peek() in ("[", "."):
            if self._next() == ".":
                place = Place(place.get(), self._next().upper())
                continue
            if self._peek() == "]":
                self._next()
                continue
            index = [self._level(0)]
            while self._peek() == ",":
                self._next()
                index.append(self._level(0))
            self._next("]")
            place = _element(place.get(), index)
        return place


def _element(array: Any, index: list[int]) -> Place:
    if isinstance(array, Text):
        while len(array) < index[0]:
            array.append(0)
        return Place(array, index[0] - 1)
    if isinstance(array, str):
        return Place([ord(array[index[0] - 1])], 0)
    return Place(array, tuple(index))


def _operate(sign: str, a: Any, b: Any) -> Any:
    match sign:
        case "OR":
            return a or b
        case "AND":
            return a and b
        case "==":
            return _plain(a) == _plain(b)
        case "<>":
            return _plain(a) != _plain(b)
        case "<":
            return a < b
        case ">":
            return a > b
        case "<=":
            return a <= b
        case ">=":
            return a >= b
        case "B_AND":
            return whole(a & b)
        case "B_EXOR":
            return whole(a ^ b)
        case "+":
            return _number(a + b)
        case "-":
            return _number(a - b)
        case "*":
            return _number(a * b)
        case "/":
            return a / b if isinstance(a, float) or isinstance(b, float) else int(a / b)
    raise AssertionError(sign)


def _number(value: Any) -> Any:
    """A whole number that does not fit is an error of the program: KRL stops there."""
    assert isinstance(value, float) or value == whole(value), f"{value} does not fit into 32 bits"
    return value


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Text) else value


def _is_text(value: Any) -> bool:
    """Whether it is a CHAR array or a text in quotation marks; an enumeration's value is neither."""
    return isinstance(value, Text) or (isinstance(value, str) and not value.startswith("#"))


def _text(value: Any) -> list[int]:
    return [code for code in (value if isinstance(value, Text) else map(ord, str(value))) if code]


def _copy(value: Any) -> Any:
    if isinstance(value, Text):
        return Text(value)
    return dict(value) if isinstance(value, dict) else value


def _has(place: Place) -> bool:
    return isinstance(place.store, list) or place.key in place.store


def _fresh(kind: str, size: str) -> Any:
    if kind == "CHAR":
        return Text()
    if kind in ("AXIS", "E6AXIS", "EKI_STATUS"):
        return {}
    return {} if size else 0.0 if kind == "REAL" else 0


def _parameters(text: str) -> list[Parameter]:
    pairs = [part.strip().split(":") for part in text.split(",") if part.strip()]
    return [Parameter(name.replace("[]", "").strip(), way == "OUT", name.endswith("[]")) for name, way in pairs]


@cache
def _tokens(text: str) -> tuple[str, ...]:
    tokens, at = [], 0
    while at < len(text.rstrip()):
        found = _TOKEN.match(text, at)
        assert found, f"cannot read: {text[at:]}"
        token = found.group().strip()
        tokens.append(token.upper() if found["name"] else token)
        at = found.end()
    return tuple(tokens)


def _is_assignment(line: str) -> tuple[str, str] | None:
    found = re.match(r"(\$?\w+(?:\[[^=]*?\])?(?:\.\w+)?(?:\[\])?)=(?!=)(.*)$", line)
    return (found[1], found[2]) if found else None


def _closing(lines: list[str], at: int, word: str, end: str) -> int:
    depth = 0
    for n in range(at, len(lines)):
        depth += lines[n].startswith(f"{word} ") or lines[n] == word
        depth -= lines[n] == end
        if not depth:
            return n
    raise AssertionError(f"no {end} for: {lines[at]}")


def _depth(lines: list[str], at: int, to: int) -> int:
    opened = sum(line.startswith("IF ") for line in lines[at:to])
    return opened - sum(line == "ENDIF" for line in lines[at:to])


def config(torch: tuple[float, ...] = TORCH, table: tuple[float, ...] = TABLE) -> str:
    rows = {"TOOL_DATA[1]": torch, "TOOL_DATA[2]": (0.0, 0.0, 300.0, 0.0, 0.0, 0.0), "BASE_DATA[2]": table}
    lines = [f"{name}={{{components(values)}}}" for name, values in rows.items()]
    return "\r\n".join(["DEFDAT $CONFIG", "DECL FRAME TOOL_DATA[16]", "DECL FRAME BASE_DATA[32]", *lines, "ENDDAT", ""])


def components(values: tuple[float, ...] | Floats) -> str:
    return ",".join(f"{label} {value:.9f}" for label, value in zip("XYZABC", values, strict=True))


def readings_at(shift: tuple[float, float, float], start: Floats = CORNER) -> Floats:
    """Readings of the nominal robot with its tool moved by `shift`, mm, from where it is at `start`."""
    goal = CHAIN.forward(JOINTS.model(start))
    goal[:3, 3] += shift
    found = inverse(CHAIN, goal, JOINTS.model(start))
    assert found.converged
    return np.asarray(JOINTS.readings(found.q))


def position(readings: Floats, base: Floats = BASE) -> str:
    """`X …,Y …,Z …,A …,B …,C …,S …,T …` of the tool at `readings`, in `base`."""
    pose = inverse_pose(base) @ CHAIN.forward(JOINTS.model(readings))
    status, turn = int(status_of(CHAIN, JOINTS, readings)), int(turn_of(readings))
    return f"{components(np.array([*pose[:3, 3], *abc_from_rotation(pose[:3, :3])]))},S {status},T {turn}"


def joints(readings: Floats) -> str:
    return ",".join(f"A{axis} {value:.9f}" for axis, value in enumerate(readings, 1))


@dataclass
class Seam:
    """A program under construction. name: of the module."""

    name: str = "SEAM"
    src: list[str] = field(default_factory=list)
    dat: list[str] = field(default_factory=list)

    def point(self, name: str, value: str, tool: int = 1, base: int = 2, kind: str = "E6POS") -> None:
        external = ",".join(f"E{axis} 0.0" for axis in range(1, 7))
        self.dat += [
            f"DECL {kind} X{name}={{{value},{external}}}",
            f'DECL FDAT F{name}={{TOOL_NO {tool},BASE_NO {base},IPO_FRAME #BASE,POINT2[] " ",TQ_STATE FALSE}}',
        ]

    def form(self, kind: str, *names: str, fdat: str | None = None) -> None:
        """An inline form; of a circle auxiliary and end point."""
        path = kind in ("LIN", "CIRC")
        self.src += [
            f";FOLD {kind} {' '.join(names)} Vel=2 m/s CPDAT1 Tool[1]:torch Base[2]:table;%{{PE}}%R 8.3.48",
            "LDAT_ACT=LCPDAT1" if path else "PDAT_ACT=PPDAT1",
            f"FDAT_ACT={fdat or f'F{names[-1]}'}",
            "BAS(#CP_PARAMS,2)" if path else "BAS(#PTP_PARAMS,100)",
            f"{kind} {', '.join(f'X{name}' for name in names)}",
            ";ENDFOLD",
        ]

    def write(self, folder: Path, end: str = "\r\n", *, finish: bool = True) -> None:
        """seam.src and seam.dat in Latin-1; finish: with END and a last line end."""
        head = ["&ACCESS RVP", f"DEF {self.name}( )", ";FOLD INI", "BAS(#INITMOV,0)", ";ENDFOLD"]
        src = end.join([*head, *self.src, *(["END", ""] if finish else [])])
        ldat = "DECL LDAT LCPDAT1={VEL 2.0,ACC 100.0,ORI_TYP #VAR,CIRC_TYP #BASE}"
        pdat = "DECL PDAT PPDAT1={VEL 100.0,ACC 100.0}"
        dat = end.join(["&ACCESS RVP", f"DEFDAT {self.name} PUBLIC", *self.dat, ldat, pdat, "ENDDAT", ""])
        (folder / "seam.src").write_bytes(src.encode("latin-1"))
        (folder / "seam.dat").write_bytes(dat.encode("latin-1"))
        (folder / "$config.dat").write_bytes(config().encode("latin-1"))


def usual_seam() -> Seam:
    """PTP, LIN, CIRC, LIN in the region of `kr5_model`."""
    seam = Seam()
    places = {
        "P1": (0, 0, 0),
        "P2": (-20, 150, -40),
        "P3": (-80, 190, -60),
        "P4": (-120, 130, -60),
        "P5": (-60, 20, 30),
    }
    for name, shift in places.items():
        seam.point(name, position(readings_at(shift)))
    seam.form("PTP", "P1")
    seam.form("LIN", "P2")
    seam.form("CIRC", "P3", "P4")
    seam.form("LIN", "P5")
    return seam
