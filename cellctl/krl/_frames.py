"""Tool and base of each motion: from the FDAT of its inline form, from `WITH`, or from `$TOOL` and `$BASE` before it.

A program is followed from top to bottom. After a branch a frame is certain if all ways through it leave the same. In a
loop that sets frames, in a subprogram before it sets them, after a label and after the call of a subprogram of another
file they are not certain: the reason says so.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import final

from cellctl.krl._expressions import Aggregate, Call, Expression, Literal, Reference
from cellctl.krl._krl_file import KrlFile
from cellctl.krl._points import CARTESIAN, FrameData, Point, point_of, whole
from cellctl.krl.statements import Assignment, Begin, Control, End, Invocation, Motion, Spline, Statement, Unknown

_NULL = ("$NULLFRAME", "$WORLD")
_SET = frozenset({"$TOOL", "$BASE", "$IPO_MODE", "FDAT_ACT"})
_SET_NOTHING = ("SET_CD_PARAMS", "PULSE")
_FRAMES_OF_POINT = ("STOOL", "STOOL2", "SBASE", "SIPO_MODE")


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
class FrameState:
    """What is in force at a place of a program. fixed_tool: the robot carries the part. fdat: name in FDAT_ACT."""

    tool: FrameChoice
    base: FrameChoice
    fixed_tool: bool = False
    fdat: str = ""

    @classmethod
    def uncertain(cls, reason: str, fdat: str = "") -> FrameState:
        """Nothing is certain, for this reason."""
        return cls(FrameChoice(reason=reason), FrameChoice(reason=reason), fdat=fdat)


@final
class FrameReader:
    """Reads the statements of `program` that set frames. data: its data list, `$config.dat`, in the order of search."""

    def __init__(self, program: KrlFile, data: Sequence[KrlFile]) -> None:
        self._program = program
        self._files = (program, *data)
        self._routines = _routines(program.statements)

    def assigned(self, state: FrameState, statement: Assignment) -> FrameState:
        """The state after an assignment."""
        match statement.target.written.upper():
            case "$TOOL":
                return replace(state, tool=self._choice(statement, "TOOL_DATA", lambda fdat: fdat.tool_no))
            case "$BASE":
                return replace(state, base=self._choice(statement, "BASE_DATA", lambda fdat: fdat.base_no))
            case "$IPO_MODE":
                return replace(state, fixed_tool=self._fixed(statement.value))
            case "FDAT_ACT":
                return replace(state, fdat=statement.value.written if isinstance(statement.value, Reference) else "")
        if statement.target.name.upper() in _SET:
            return FrameState.uncertain(f"line {statement.line} changes a part of it")
        return state

    def called(self, state: FrameState, call: Call) -> FrameState:
        """The state after the call of a subprogram."""
        if call.name.upper() != "BAS":
            certain = not self._call_sets(call, ())
            return state if certain else FrameState.uncertain(f"{call.name}( ) may have changed it")
        command = call.arguments[0] if call.arguments else None
        name = command.text.upper().replace(" ", "") if isinstance(command, Literal) else ""
        match name:
            case "#PTP_PARAMS" | "#CP_PARAMS" | "#FRAMES":
                return self._frames_of_fdat(state)
            case "#TOOL":
                return replace(state, tool=self._numbered(_second(call), "TOOL_DATA", "BAS(#TOOL) computes it"))
            case "#BASE":
                return replace(state, base=self._numbered(_second(call), "BASE_DATA", "BAS(#BASE) computes it"))
            case "#INITMOV":
                return FrameState.uncertain("the program does not set it before", state.fdat)
        return state

    def may_set(self, statement: Statement, inside: tuple[str, ...] = ()) -> bool:
        """Whether a statement may set frames. inside: routines of this file that call each other, up to here."""
        match statement:
            case Assignment():
                return statement.target.name.upper() in _SET
            case Invocation():
                return self._call_sets(statement.call, inside)
            case _:
                return isinstance(statement, Unknown)

    def _call_sets(self, call: Call, inside: tuple[str, ...]) -> bool:
        """Whether a subprogram may set frames; those of other files may."""
        name = call.name.upper()
        if name in _SET_NOTHING or name in inside:
            return False
        body = self._routines.get(name)
        return body is None or any(self.may_set(statement, (*inside, name)) for statement in body)

    def _choice(self, statement: Assignment, array: str, number: Callable[[FrameData], int | None]) -> FrameChoice:
        value, computed = statement.value, f"line {statement.line} computes it"
        if isinstance(value, Aggregate):
            frame = point_of(value, statement.line, type_="FRAME")
            return FrameChoice(frame=frame) if frame else FrameChoice(reason=computed)
        if isinstance(value, Reference) and value.written.upper() in _NULL:
            return FrameChoice(0)
        if isinstance(value, Reference) and value.name.upper() == array:
            index = value.path[0][0] if len(value.path) == 1 and isinstance(value.path[0], tuple) else None
            return self._numbered(whole(index), array, computed)
        name = _fdat_of(value)
        if not name:
            return FrameChoice(reason=computed)
        fdat, reason = self._fdat(name)
        return self._numbered(number(fdat), array, f"{name} does not give it") if fdat else FrameChoice(reason=reason)

    def _numbered(self, number: int | None, array: str, reason: str) -> FrameChoice:
        if number is None:
            return FrameChoice(reason=reason)
        changes = self._program.changes(array)
        return FrameChoice(reason=f"line {changes[0].line} may change {array}") if changes else FrameChoice(number)

    def _fdat(self, name: str) -> tuple[FrameData | None, str]:
        """The FDAT, or why it is not certain."""
        if changes := self._program.changes(name):
            return None, f"line {changes[0].line} may change {name}"
        found = (file.frame_data(name) for file in self._files)
        return next((data for data in found if data is not None), None), f"the FDAT {name} is not in these files"

    def _fixed(self, value: Expression) -> bool:
        if isinstance(value, Literal):
            return value.text.upper().replace(" ", "") == "#TCP"
        name = _fdat_of(value)
        fdat, _ = self._fdat(name) if name else (None, "")
        return fdat is not None and fdat.ipo_frame == "#TCP"

    def _frames_of_fdat(self, state: FrameState) -> FrameState:
        if not state.fdat:
            return FrameState.uncertain("FDAT_ACT is not set before")
        fdat, reason = self._fdat(state.fdat)
        if fdat is None:
            return FrameState.uncertain(reason, state.fdat)
        missing = f"{state.fdat} does not give it"
        tool = self._numbered(fdat.tool_no, "TOOL_DATA", missing)
        base = self._numbered(fdat.base_no, "BASE_DATA", missing)
        return FrameState(tool, base, fdat.ipo_frame == "#TCP", state.fdat)


def _routines(statements: Sequence[Statement]) -> dict[str, list[Statement]]:
    """The statements of each routine of a file, by its name in upper case."""
    found: dict[str, list[Statement]] = {}
    body: list[Statement] = []
    for statement in statements:
        if isinstance(statement, Begin):
            body = found.setdefault(statement.name.upper(), [])
        elif isinstance(statement, End):
            body = []
        else:
            body.append(statement)
    return found


def _second(call: Call) -> int | None:
    return whole(call.arguments[1] if len(call.arguments) > 1 else None)


def _fdat_of(value: Expression) -> str:
    """`FP1` of `STOOL2(FP1)`, `SBASE(FP1.BASE_NO)` or `SIPO_MODE(FP1.IPO_FRAME)`; empty for anything else."""
    argument = value.arguments[0] if isinstance(value, Call) and len(value.arguments) == 1 else None
    if not isinstance(value, Call) or value.name.upper() not in _FRAMES_OF_POINT or not isinstance(argument, Reference):
        return ""
    path = argument.path[:-1] if argument.path and isinstance(argument.path[-1], str) else argument.path
    return replace(argument, path=path).written


_LOOPS = {"FOR": "ENDFOR", "WHILE": "ENDWHILE", "REPEAT": "UNTIL", "LOOP": "ENDLOOP"}
_BRANCHES = {"IF": "ENDIF", "SWITCH": "ENDSWITCH"}
_ENDS = {end: start for start, end in (_LOOPS | _BRANCHES).items()}
_FRAMES = frozenset({"$TOOL", "$BASE", "FDAT_ACT"})


@final
@dataclass(frozen=True, slots=True)
class MotionFrames:
    """Tool and base of a motion. fixed_tool: the tool is in the cell and the robot carries the part (`#TCP`)."""

    motion: Motion
    tool: FrameChoice
    base: FrameChoice
    fixed_tool: bool = False


@final
@dataclass(slots=True)
class _Block:
    """A branch or loop that is open: its state at the start, and at the end of each way through it so far."""

    keyword: str
    start: FrameState
    ways: list[FrameState]
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
        self._program = program
        self._statements = program.statements
        self._reader = FrameReader(program, data)
        self._state = FrameState.uncertain("the program does not set it before")
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
                    self._state = FrameState.uncertain(f"{statement.name} does not set it before")
                    self._blocks, self._spline = [], ()
                case Assignment():
                    self._state = self._reader.assigned(self._state, statement)
                case Invocation():
                    self._state = self._reader.called(self._state, statement.call)
                case Control():
                    self._control(statement, place)
                case Unknown():
                    if statement.names & _FRAMES or "(" in self._program.source(statement.span):
                        self._state = FrameState.uncertain(f"line {statement.line} is not understood")
                case _:
                    pass

    def _motion(self, motion: Motion) -> MotionFrames:
        state = self._state
        for setting in (*self._spline, *motion.settings) if motion.spline else motion.settings:
            state = self._reader.assigned(state, setting)
        return MotionFrames(motion, state.tool, state.base, state.fixed_tool)

    def _control(self, statement: Control, place: int) -> None:
        keyword = statement.keyword
        if keyword == ":":
            self._state = FrameState.uncertain("a GOTO may come here")
        elif keyword in ("TRIGGER", "INTERRUPT") and statement.names & _FRAMES:
            self._state = FrameState.uncertain(f"{keyword} in line {statement.line} sets it at another time")
        elif keyword in _LOOPS or keyword in _BRANCHES:
            if keyword in _LOOPS and self._sets_frames(place, keyword):
                self._state = FrameState.uncertain("it is set later in the same loop")
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
            self._state, self._blocks = FrameState.uncertain(f"{keyword} ends no block"), []
            return
        ways = [*block.ways, self._state, *([] if block.complete else [block.start])]
        if any(way != ways[0] for way in ways):
            self._state = FrameState.uncertain(f"it depends on the way through {block.keyword}")

    def _sets_frames(self, place: int, keyword: str) -> bool:
        depth = 0
        for statement in self._statements[place:]:
            if isinstance(statement, Control):
                depth += (statement.keyword == keyword) - (statement.keyword == _LOOPS[keyword])
            if depth == 0:
                return False
            if self._reader.may_set(statement):
                return True
        return True
