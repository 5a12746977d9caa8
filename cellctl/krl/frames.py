"""Tool and base of each motion: from the FDAT of its inline form, from `WITH`, or from `$TOOL` and `$BASE` before it.

A program is followed from top to bottom. After a branch a frame is certain if all ways through it leave the same. In a
loop that sets frames, in a subprogram before it sets them, after a label and after the call of a subprogram they are
not certain: the reason says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import final

from cellctl.krl.expressions import Aggregate, Call, Expression, Reference
from cellctl.krl.expressions import Literal as Constant
from cellctl.krl.krl_file import KrlFile
from cellctl.krl.points import CARTESIAN, FrameData, Point, point_of, whole
from cellctl.krl.statements import (
    Assignment,
    Begin,
    Control,
    Invocation,
    Motion,
    Spline,
    Statement,
    Unknown,
)

_NULL = ("$NULLFRAME", "$WORLD")
_LOOPS = {"FOR": "ENDFOR", "WHILE": "ENDWHILE", "REPEAT": "UNTIL", "LOOP": "ENDLOOP"}
_BRANCHES = {"IF": "ENDIF", "SWITCH": "ENDSWITCH"}
_ENDS = {end: start for start, end in (_LOOPS | _BRANCHES).items()}
_NO_SUBPROGRAMS = ("BAS", "SET_CD_PARAMS", "PULSE")


@final
@dataclass(frozen=True, slots=True)
class FrameChoice:
    """A tool or base: a number of TOOL_DATA or BASE_DATA (0: no tool, the robot's base), or a frame written out.

    reason: why it is not certain, empty where it is.
    """

    number: int | None = None
    frame: Point | None = None
    reason: str = ""


@final
@dataclass(frozen=True, slots=True)
class MotionFrames:
    """Tool and base of a motion. fixed_tool: the tool is in the cell and the robot carries the part (`#TCP`)."""

    motion: Motion
    tool: FrameChoice
    base: FrameChoice
    fixed_tool: bool = False


@final
@dataclass(frozen=True, slots=True)
class _State:
    """What is in force at a place of the program. fdat: name in FDAT_ACT."""

    tool: FrameChoice
    base: FrameChoice
    fixed_tool: bool = False
    fdat: str = ""

    @classmethod
    def uncertain(cls, reason: str) -> _State:
        return cls(FrameChoice(reason=reason), FrameChoice(reason=reason))


@dataclass(slots=True)
class _Block:
    """A branch or loop that is open: its state at the start, and at the end of each way through it so far."""

    keyword: str
    start: _State
    ways: list[_State]
    complete: bool = False
    first: bool = True


def motion_frames(program: KrlFile, data: Sequence[KrlFile] = ()) -> tuple[MotionFrames, ...]:
    """Tool and base of every motion of `program`. data: its data list, `$config.dat`, in the order of the search."""
    return tuple(_Follower(program, data).follow())


def frame_values(choice: FrameChoice, array: str, data: Sequence[KrlFile]) -> dict[str, float] | None:
    """X, Y, Z, mm, A, B, C, deg, of a choice; array: `TOOL_DATA` or `BASE_DATA`. None where `data` does not have it."""
    if choice.number == 0:
        return dict.fromkeys(CARTESIAN, 0.0)
    found = choice.frame
    if choice.number is not None:
        frames = (file.frame(f"{array}[{choice.number}]") for file in data)
        found = next((frame for frame in frames if frame is not None), None)
    if found is None or found.fault or found.missing:
        return None
    return {label: found.values[label] for label in CARTESIAN}


class _Follower:
    """Follows one program."""

    def __init__(self, program: KrlFile, data: Sequence[KrlFile]) -> None:
        self._statements = program.statements
        self._files = (program, *data)
        self._state = _State.uncertain("the program does not set it before")
        self._blocks: list[_Block] = []
        self._spline: tuple[Assignment, ...] = ()

    def follow(self) -> Iterator[MotionFrames]:
        for place, statement in enumerate(self._statements):
            match statement:
                case Motion():
                    yield self._motion(statement)
                case Spline():
                    self._spline = statement.settings
                case Begin():
                    self._state = _State.uncertain(f"{statement.name} does not set it before")
                    self._blocks = []
                case Assignment():
                    self._state = self._assigned(self._state, statement)
                case Invocation():
                    self._call(statement.call)
                case Control():
                    self._control(statement, place)
                case Unknown():
                    if statement.names & {"$TOOL", "$BASE", "FDAT_ACT"}:
                        self._state = _State.uncertain(f"line {statement.line} is not understood")
                case _:
                    pass

    def _motion(self, motion: Motion) -> MotionFrames:
        state = self._state
        for setting in (*self._spline, *motion.settings) if motion.spline else motion.settings:
            state = self._assigned(state, setting)
        return MotionFrames(motion, state.tool, state.base, state.fixed_tool)

    def _assigned(self, state: _State, statement: Assignment) -> _State:
        match statement.target.written.upper():
            case "$TOOL":
                return replace(state, tool=self._choice(statement, "TOOL_DATA", lambda fdat: fdat.tool_no))
            case "$BASE":
                return replace(state, base=self._choice(statement, "BASE_DATA", lambda fdat: fdat.base_no))
            case "$IPO_MODE":
                return replace(state, fixed_tool=self._fixed(statement.value))
            case "FDAT_ACT":
                return replace(state, fdat=statement.value.written if isinstance(statement.value, Reference) else "")
        if statement.target.name.upper() in ("$TOOL", "$BASE"):
            return _State.uncertain(f"line {statement.line} changes a part of it")
        return state

    def _choice(self, statement: Assignment, array: str, number: Callable[[FrameData], int | None]) -> FrameChoice:
        value = statement.value
        uncertain = FrameChoice(reason=f"line {statement.line} computes it")
        if isinstance(value, Aggregate):
            frame = point_of(value, statement.line, type_="FRAME")
            return FrameChoice(frame=frame) if frame else uncertain
        if isinstance(value, Reference) and value.written.upper() in _NULL:
            return FrameChoice(0)
        if isinstance(value, Reference) and value.certain and value.name.upper() == array and value.path:
            index = value.path[0][0] if isinstance(value.path[0], tuple) and len(value.path) == 1 else None
            return _numbered(whole(index), uncertain.reason)
        name = _fdat_of(value)
        fdat = self._fdat(name)
        if name and fdat is None:
            return FrameChoice(reason=f"the FDAT {name} is not in these files")
        return _numbered(number(fdat) if fdat else None, uncertain.reason)

    def _fdat(self, name: str) -> FrameData | None:
        found = (file.frame_data(name) for file in self._files)
        return next((data for data in found if data is not None), None) if name else None

    def _fixed(self, value: Expression) -> bool:
        if isinstance(value, Constant):
            return value.text.upper().replace(" ", "") == "#TCP"
        fdat = self._fdat(_fdat_of(value))
        return fdat is not None and fdat.ipo_frame == "#TCP"

    def _call(self, call: Call) -> None:
        command = call.arguments[0] if call.arguments else None
        name = command.text.upper().replace(" ", "") if isinstance(command, Constant) else ""
        if call.name.upper() != "BAS":
            if call.name.upper() not in _NO_SUBPROGRAMS:
                self._state = _State.uncertain(f"{call.name}( ) may have changed it")
        elif name in ("#PTP_PARAMS", "#CP_PARAMS", "#FRAMES"):
            self._frames_of_fdat()
        elif name in ("#TOOL", "#BASE"):
            number = whole(call.arguments[1] if len(call.arguments) > 1 else None)
            chosen = _numbered(number, f"BAS({name}) computes it")
            tool, base = (chosen, self._state.base) if name == "#TOOL" else (self._state.tool, chosen)
            self._state = replace(self._state, tool=tool, base=base)
        elif name == "#INITMOV":
            self._state = replace(_State.uncertain("the program does not set it before"), fdat=self._state.fdat)

    def _frames_of_fdat(self) -> None:
        name, fdat = self._state.fdat, self._fdat(self._state.fdat)
        if fdat is None:
            reason = f"the FDAT {name} is not in these files" if name else "FDAT_ACT is not set before"
            self._state = replace(_State.uncertain(reason), fdat=name)
        else:
            tool, base = (_numbered(number, f"{name} does not give it") for number in (fdat.tool_no, fdat.base_no))
            self._state = replace(self._state, tool=tool, base=base, fixed_tool=fdat.ipo_frame == "#TCP")

    def _control(self, statement: Control, place: int) -> None:
        keyword = statement.keyword
        if keyword == ":":
            self._state = _State.uncertain("a GOTO may come here")
        elif keyword in _LOOPS or keyword in _BRANCHES:
            if keyword in _LOOPS and self._sets_frames(place, keyword):
                self._state = _State.uncertain("it is set later in the same loop")
            self._blocks.append(_Block(keyword, self._state, []))
        elif keyword in ("ELSE", "CASE", "DEFAULT") and self._blocks:
            self._next_way(self._blocks[-1], keyword)
        elif keyword in _ENDS:
            self._end_block(keyword)

    def _next_way(self, block: _Block, keyword: str) -> None:
        if not (block.first and keyword != "ELSE"):  # nothing is between SWITCH and its first CASE
            block.ways.append(self._state)
        block.first = False
        block.complete = block.complete or keyword != "CASE"
        self._state = block.start

    def _end_block(self, keyword: str) -> None:
        block = self._blocks.pop() if self._blocks else None
        if block is None or block.keyword != _ENDS[keyword]:
            self._state, self._blocks = _State.uncertain(f"{keyword} ends no block"), []
            return
        ways = [*block.ways, self._state, *([] if block.complete else [block.start])]
        if any(way != ways[0] for way in ways):
            self._state = _State.uncertain(f"it depends on the way through {block.keyword}")

    def _sets_frames(self, place: int, keyword: str) -> bool:
        depth = 0
        for statement in self._statements[place:]:
            if isinstance(statement, Control):
                depth += (statement.keyword == keyword) - (statement.keyword == _LOOPS[keyword])
            if depth == 0:
                return False
            if _may_set(statement):
                return True
        return True


def _may_set(statement: Statement) -> bool:
    match statement:
        case Assignment():
            return statement.target.name.upper() in ("$TOOL", "$BASE", "$IPO_MODE", "FDAT_ACT")
        case Invocation():
            return statement.call.name.upper() not in _NO_SUBPROGRAMS or statement.call.name.upper() == "BAS"
        case _:
            return isinstance(statement, Unknown)


def _numbered(number: int | None, reason: str) -> FrameChoice:
    return FrameChoice(number) if number is not None else FrameChoice(reason=reason)


def _fdat_of(value: Expression) -> str:
    """`FP1` of `STOOL2(FP1)`, `SBASE(FP1.BASE_NO)` or `SIPO_MODE(FP1.IPO_FRAME)`; empty for anything else."""
    if not isinstance(value, Call) or value.name.upper() not in ("STOOL", "STOOL2", "SBASE", "SIPO_MODE"):
        return ""
    argument = value.arguments[0] if len(value.arguments) == 1 else None
    return argument.name if isinstance(argument, Reference) and len(argument.path) <= 1 else ""
