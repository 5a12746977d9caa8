"""URScript motions: from where to which point, with which tool and feature.

A program is gone through once from its beginning, its functions with what is certain at their calls.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import final

from cellctl.files.spans import Span
from cellctl.operations.programs._language import Frame, Move, Numbers, Unchanged
from cellctl.operations.programs._urscript_points import (
    KINDS,
    PART,
    RADIUS,
    ScriptPoint,
    ScriptPoints,
    calls_of,
    calls_within,
    uncertain_tool,
)
from cellctl.urscript import (
    Branches,
    Call,
    Evaluation,
    Expression,
    Function,
    Loop,
    Number,
    ScriptFile,
    Statement,
    Unknown,
    calls,
    every,
)

_WITHOUT_POINT = frozenset({"servoj", "servoc", "servol", "speedj", "speedl"})
_MOVES_WITHOUT_TOOLS = ("stop", "force_mode", "end_", "freedrive", "teach")
"""Functions that may move the arm and leave the TCP as it is set begin with these."""
_TIME = {"movej": 3, "movel": 3}
"""Place of the argument t: how long the whole motion takes."""
_STAYS = re.compile(
    r"(get|set|read|write|is|to|modbus|rtde|socket|pose|str|list|zero|rpc|tool)_\w+"
    r"|sleep|sync|textmsg|popup|request_\w+|d2r|r2d|floor|ceil|sqrt|pow|norm|length|point_dist|wrench_trans"
    r"|interpolate_pose|integer_to_binary_list|binary_list_to_integer|random|a?(sin|cos|tan)|atan2|log|force"
)
"""Functions of the controller after which the arm is where it was, with the same TCP (besides `set_tcp`, `set_pos`)."""


@final
@dataclass(frozen=True, slots=True)
class _State:
    """At a place of the program. tool: in force. start: the motion before, None where it is not certain. before: the
    motion above, from which a posture is taken.
    """

    tool: Frame
    start: int | None = None
    before: int | None = None


@final
@dataclass(frozen=True)
class ScriptMotions:
    """Reads the motions of a program. tool: stated by a person, for all motions."""

    file: ScriptFile
    tool: Numbers | None = None
    _motions: list[tuple[Move, Evaluation]] = field(default_factory=list, init=False, repr=False)
    _at_calls: dict[str, list[_State]] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def find(self) -> ScriptPoints:
        """Points, features and tools."""
        return ScriptPoints(self.file)

    @cached_property
    def moves(self) -> tuple[Move, ...]:
        """All motions of the robot. Raises InputError where blocks and their `end` do not match."""
        return tuple(move for move, _ in self._read)

    @cached_property
    def statements(self) -> Mapping[int, Evaluation]:
        """The statement of each motion, by its place."""
        return {move.place: statement for move, statement in self._read}

    @cached_property
    def not_understood(self) -> tuple[Unchanged, ...]:
        """Lines that are not understood, and motions without a point."""
        found = []
        for each in every(self.file.statements):
            if isinstance(each, Unknown):
                found.append(Unchanged(PART, each.line, "", f"not understood: {each.reason}"))
            without = [call.name for call in calls_of(each) if call.name in _WITHOUT_POINT]
            what = "it has no point that stays: not compensated"
            found += [Unchanged(PART, each.line, name, what) for name in without]
        return tuple(found)

    @cached_property
    def points(self) -> dict[Span, ScriptPoint]:
        """The points of its motions, by their place."""
        found = dict[Span, ScriptPoint]()
        for _, statement in self._read:
            assert isinstance(statement.value, Call)
            for target in self.find.targets(statement.value):
                if isinstance(target.point, ScriptPoint):
                    found[target.point.span] = target.point
        return found

    @property
    def tools(self) -> list[str]:
        """The tools of its motions, where there are several."""
        found = {}
        for each in every(self.file.statements):
            for call in calls_of(each):
                if call.name == "set_tcp":
                    frame = self._set_tcp(call, each.line)
                    found[frame.numbers] = frame.name
        return sorted(found.values()) if len(found) > 1 else []

    @cached_property
    def _read(self) -> list[tuple[Move, Evaluation]]:
        state = _State(uncertain_tool("the program has not set it (set_tcp): give --tool"))
        if self._threads_move:
            state = _State(uncertain_tool("a thread moves the arm or sets the TCP"))
        top = self.file.statements
        main = [each for each in top if isinstance(each, Function) and each.kind != "thread"]
        if len(main) == 1 and all(isinstance(each, Function) for each in top):
            read = {main[0].name}
            self._body(main[0].body, state)
        else:
            read = set[str]()
            self._body(top, state)
        while waiting := [name for name in self.file.functions if name not in read]:
            name = next((each for each in waiting if not self._callers(each) & set(waiting) - {each}), waiting[0])
            read.add(name)
            self._body(self.file.functions[name].body, self._at_beginning(name))
        self._motions.sort(key=lambda each: each[0].place)
        return self._in_order(self._motions)

    @staticmethod
    def _in_order(found: list[tuple[Move, Evaluation]]) -> list[tuple[Move, Evaluation]]:
        """Starts are places while the program is read; here they become indices."""
        index = {move.place: number for number, (move, _) in enumerate(found)}
        return [
            (replace(move, start=None if move.start is None else index[move.start]), statement)
            for move, statement in found
        ]

    def _callers(self, name: str) -> set[str]:
        return {
            each.name
            for each in self.file.functions.values()
            if any(call.name == name for inner in each.body for call in calls_within(inner))
        }

    def _at_beginning(self, name: str) -> _State:
        """What is certain at the beginning of a function: the tool, where it is the same at all calls."""
        states = self._at_calls.get(name, [])
        if not states or self.file.functions[name].kind == "thread" or name in self._callers(name):
            return _State(uncertain_tool(f"{name} is not called here, or as a thread, or by itself"))
        return _State(_merged(state.tool for state in states))

    @cached_property
    def _threads_move(self) -> bool:
        """Whether a thread moves the arm or sets the TCP: then nothing is certain of what the others do."""
        found = {*KINDS, *_WITHOUT_POINT, "set_tcp"}
        threads = [each for each in self.file.functions.values() if each.kind == "thread"]
        inner = [call for thread in threads for statement in thread.body for call in calls_within(statement)]
        return any(self._leads_to(call, found, set()) for call in inner)

    def _sets_tools(self, call: Call) -> bool:
        return self._leads_to(call, {"set_tcp"}, set())

    def _leads_to(self, call: Call, wanted: set[str], seen: set[str]) -> bool:
        """Whether a call is one of the functions `wanted`, or calls one; seen: functions that were looked at."""
        function = self.file.functions.get(call.name)
        if function is None:
            return call.name in wanted
        if call.name in seen:
            return False
        inner = (each for statement in function.body for each in calls_within(statement))
        return any(self._leads_to(each, wanted, {*seen, call.name}) for each in inner)

    def _body(self, body: Iterable[Statement], state: _State) -> _State:
        for statement in body:
            match statement:
                case Function():
                    pass
                case Unknown():
                    state = _State(uncertain_tool(f"line {statement.line} is not understood"), before=state.before)
                case Branches():
                    state = self._branches(statement, state)
                case Loop():
                    state = self._loop(statement, state)
                case Evaluation() if isinstance(statement.value, Call) and statement.value.name in KINDS:
                    state = self._motion(statement, statement.value, state)
                case _:
                    for call in calls_of(statement):
                        state = self._called(call, statement, state)
        return state

    def _branches(self, statement: Branches, state: _State) -> _State:
        for condition in statement.conditions:
            for call in calls(condition):
                state = self._called(call, statement, state)
        ends = [self._body(body, state) for body in statement.bodies]
        ends += [] if statement.has_else else [state]
        starts = {end.start for end in ends}
        return _State(_merged(end.tool for end in ends), starts.pop() if len(starts) == 1 else None, ends[0].before)

    def _loop(self, statement: Loop, state: _State) -> _State:
        again = [call for inner in statement.body for call in calls_within(inner)] + list(calls(statement.condition))
        tool = state.tool
        for call in again:
            if call.name == "set_tcp":
                tool = _merged([tool, self._set_tcp(call, statement.line)])
            elif self._sets_tools(call):
                tool = uncertain_tool(f"{call.name} may set it, in a loop")
        moves = any(call.name in KINDS or not self._stays(call) for call in again)
        begin = _State(tool, None if moves else state.start, state.before)
        end = self._body(statement.body, begin)
        return _State(_merged([begin.tool, end.tool]), None if moves else begin.start, end.before)

    def _stays(self, call: Call) -> bool:
        return call.name not in self.file.functions and call.name != "set_pos" and bool(_STAYS.fullmatch(call.name))

    def _called(self, call: Call, statement: Statement, state: _State) -> _State:
        """After a call that is no motion."""
        if call.name == "set_tcp":
            return replace(state, tool=self._set_tcp(call, statement.line))
        if call.name in self.file.functions:
            self._at_calls.setdefault(call.name, []).append(state)
            changes = self._sets_tools(call)
            tool = uncertain_tool(f"{call.name} in line {statement.line} may set it") if changes else state.tool
            return _State(tool, before=state.before)
        if call.name in KINDS:  # inside another expression
            return _State(state.tool, before=state.before)
        if self._stays(call):
            return state
        known = call.name in _WITHOUT_POINT or call.name.startswith(_MOVES_WITHOUT_TOOLS)
        tool = state.tool if known else uncertain_tool(f"{call.name} in line {statement.line} is not in this file")
        return _State(tool, before=state.before)

    def _set_tcp(self, call: Call, line: int) -> Frame:
        if self._threads_move:
            return uncertain_tool("a thread moves the arm or sets the TCP")
        return self.find.tool(call, line)

    def _motion(self, statement: Evaluation, call: Call, state: _State) -> _State:
        targets = self.find.targets(call)
        faults = [each.point for each in targets if isinstance(each.point, str)]
        points = [each.point.read() for each in targets if isinstance(each.point, ScriptPoint)]
        bases = {each.base.numbers for each in targets}
        if len(bases) > 1:
            faults.append("its two points are in different features")
        last = targets[-1]
        if not faults and points[-1].readings is None and last.near is None and state.before is None:
            cure = "begin with a motion to joints, or write get_inverse_kin(p, qnear=[…])"
            faults.append(f"the posture in which the arm comes to it is not certain: {cure}")
        circle = call.name == "movec"
        mode = call.argument(5, "mode") if circle else None
        along = _given(mode)
        self._motions.append(
            (
                Move(
                    place=statement.span.start,
                    line=statement.line,
                    kind=KINDS[call.name],
                    written_kind=call.name,
                    target=points[-1] if not faults else None,
                    auxiliary=points[0] if circle and not faults else None,
                    angle_deg=None,
                    tool=Frame("--tool", self.tool) if self.tool is not None else state.tool,
                    base=last.base,
                    start=state.start,
                    near=last.near,
                    fault="; ".join(dict.fromkeys(faults)),
                    other_way="its orientation follows the circle (mode)" if along else "",
                    undivided=self._undivided(statement, call, state),
                ),
                statement,
            )
        )
        place = statement.span.start
        return _State(state.tool, place, place)

    def _undivided(self, statement: Evaluation, call: Call, state: _State) -> str:
        """Why no motions can be inserted before this one; empty where they can."""
        before = self.file.text[: statement.span.start].rpartition("\n")[2]
        if before.strip():
            return "something else stands before it in its line"
        if call.name in _TIME and _given(call.argument(_TIME[call.name], "t")):
            return "its time t is for the whole motion"
        if call.name == "optimovel":
            return "optimovel is not divided"
        above = next((one for one in reversed(self._motions) if one[0].place == state.start), None)
        blended = [call] + ([above[1].value] if above and isinstance(above[1].value, Call) else [])
        if any(_blend(each) for each in blended):
            return "it is blended with the motion before or after it (r)"
        return ""


def _merged(tools: Iterable[Frame]) -> Frame:
    found = list(tools)
    same = len({frame.numbers for frame in found}) == 1
    return found[0] if same else uncertain_tool("it differs by the way on which the program comes here")


def _blend(call: Call) -> bool:
    """Whether a motion has a blend radius."""
    return _given(call.argument(RADIUS.get(call.name, 4), "r"))


def _given(number: Expression | None) -> bool:
    """Whether an argument is there and not 0, which has no effect."""
    return number is not None and not (isinstance(number, Number) and number.value == 0)
