"""Tool and base of each motion: from the FDAT of its inline form, from `WITH`, or from `$TOOL` and `$BASE` before it.

A program is followed from top to bottom. After a branch a frame is certain if all ways through it leave the same. In a
loop that sets frames, in a subprogram before it sets them, after a label and after the call of a subprogram of another
file they are not certain: the reason says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import final

from cellctl.krl.frame_state import FrameChoice, FrameReader, FrameState
from cellctl.krl.krl_file import KrlFile
from cellctl.krl.points import CARTESIAN
from cellctl.krl.statements import Assignment, Begin, Control, Invocation, Motion, Spline, Unknown

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
