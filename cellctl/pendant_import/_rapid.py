"""Points of an ABB RAPID module: jointtarget (degrees) and robtarget (mm, quaternion), declared or in an instruction.

Source: ABB, technical reference manual, RAPID instructions, functions and data types: `jointtarget` [robax, extax],
`robtarget` [trans, rot, robconf, extax], 9E+09 for an axis that is not there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TypeAlias

from cellctl.pendant_import._language import Language, Targets, postures_of, targets_of
from cellctl.pendant_import._points import RawList, Source, Taught, unified

_Tree: TypeAlias = "str | list[_Tree]"

_RAPID = re.compile(
    r"\b(?:CONST|PERS|VAR)\s+(?:jointtarget|robtarget)\b|\bMoveAbsJ\b|^\s*MODULE\s+\w+", re.IGNORECASE | re.MULTILINE
)
_HIDDEN = re.compile(r'"(?:[^"\n]|"")*"|![^\n]*')
_DECLARED = re.compile(
    r"\b(?:CONST|PERS|VAR)\s+(?P<type>jointtarget|robtarget)\s+(?P<name>\w+)\s*(?:\{[\d\s,]*\})?\s*"
    r"(?P<value>:=.*)?\Z",
    re.IGNORECASE | re.DOTALL,
)
_TYPED = re.compile(r"\b(?:CONST|PERS|VAR)\s+(?P<type>\w+)\s+(?P<name>\w+)", re.IGNORECASE)
_ASSIGNED = re.compile(r"(?P<name>\w+)\s*:=\s*\Z")
_MOVED = re.compile(r"\bMove\w*\b", re.IGNORECASE)
_WORK_OBJECT = re.compile(r"\\\s*WObj\s*:=\s*(?P<name>\w+)", re.IGNORECASE)
_TOKEN = re.compile(r"\[|\]|,|[^\[\],]+")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_ABSENT = 9e8
"""A larger coordinate of an additional axis is 9E+09: there is none."""
_SHAPES = {"jointtarget": (6, 6), "robtarget": (3, 4, 4, 6)}


def is_rapid(text: str) -> bool:
    """Whether `text` is RAPID with points."""
    return _RAPID.search(text) is not None


def rapid_points(text: str) -> list[Taught]:
    """The points in the order of the module. One that is computed, or has no value, carries the reason."""
    code = _HIDDEN.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), unified(text))
    frames = _work_objects(code)
    others = {found["name"].casefold() for found in _TYPED.finditer(code) if found["type"].lower() not in _SHAPES}
    points: list[Taught] = []
    start = 0
    for statement in code.split(";"):
        points += _points_of(statement, 1 + code.count("\n", 0, start), frames, others)
        start += len(statement) + 1
    return points


def _work_objects(code: str) -> dict[str, str]:
    """Point → the work objects of the instructions that move to it, in any order."""
    used: dict[str, set[str]] = {}
    for statement in code.split(";"):
        if _MOVED.search(statement):
            named = _WORK_OBJECT.search(statement)
            for word in re.findall(r"\w+", statement):
                used.setdefault(word.casefold(), set()).add(named["name"] if named else "wobj0")
    return {point: " and ".join(sorted(names)) for point, names in used.items()}


def _points_of(statement: str, line: int, frames: dict[str, str], others: set[str]) -> Iterator[Taught]:
    """The points of one statement. others: variables of other types, whose lists of numbers are no points."""
    declared = _DECLARED.search(statement)
    if declared:
        yield from _declared(declared, line + statement.count("\n", 0, declared.start()), frames)
        return
    for place, tree in _literals(statement):
        named = _ASSIGNED.search(re.sub(r"\{[^{}]*\}", "", statement[:place]))
        name = named["name"] if named else ""
        kind = next((kind for kind in _SHAPES if _is(tree, kind)), None)
        if kind and name.casefold() not in others:
            frame = frames.get(name.casefold(), "") if named else _own_frame(statement)
            yield _point(tree, kind, name, line + statement.count("\n", 0, place), frame)


def _own_frame(statement: str) -> str:
    named = _WORK_OBJECT.search(statement)
    return named["name"] if named else "wobj0" if _MOVED.search(statement) else ""


def _declared(found: re.Match[str], line: int, frames: dict[str, str]) -> Iterator[Taught]:
    kind, name, value = found["type"].lower(), found["name"], found["value"]
    if value is None:
        yield Taught(line, name, kind, fault=f"{kind} without a value: not taught")
        return
    frame = frames.get(name.casefold(), "")
    trees = [tree for _, tree in _literals(value)][:1]
    if trees and _is(trees[0], kind):
        yield _point(trees[0], kind, name, line, frame)
    elif trees and all(_is(element, kind) for element in trees[0]):
        for place, element in enumerate(trees[0], 1):
            yield _point(element, kind, f"{name}{{{place}}}", line, frame)
    else:
        numbers = " and ".join(str(size) for size in _SHAPES[kind])
        yield Taught(line, name, kind, fault=f"is not a {kind} in numbers: lists of {numbers} are needed")


def _literals(text: str) -> Iterator[tuple[int, _Tree]]:
    """Each outermost bracketed list with its place; one that is not closed is passed over."""
    depth, start = 0, 0
    for place, mark in enumerate(text):
        if mark == "[":
            depth, start = depth + 1, start if depth else place
        elif mark == "]" and depth:
            depth -= 1
            if not depth:
                yield start, _tree(text[start : place + 1])


def _tree(text: str) -> _Tree:
    stack: list[list[_Tree]] = [[]]
    for token in _TOKEN.findall(text):
        if token == "[":
            stack.append([])
        elif token == "]":
            closed = stack.pop()
            stack[-1].append(closed)
        elif token != "," and token.strip():
            stack[-1].append(token.strip())
    return stack[0][0]


def _is(tree: _Tree, kind: str) -> bool:
    """Whether `tree` holds lists of numbers as many as this kind of target has."""
    if isinstance(tree, str) or len(tree) != len(_SHAPES[kind]):
        return False
    return all(_numbers(part) == size for part, size in zip(tree, _SHAPES[kind], strict=True))


def _numbers(part: _Tree) -> int:
    good = not isinstance(part, str) and all(isinstance(each, str) and _NUMBER.fullmatch(each) for each in part)
    return len(part) if good else -1


def _point(tree: _Tree, kind: str, name: str, line: int, frame: str) -> Taught:
    parts = [[str(each) for each in part] for part in tree]
    extra = {f"E{place}": text for place, text in enumerate(parts[-1], 1) if abs(float(text)) < _ABSENT}
    if kind == "jointtarget":
        joints = {f"A{place}": text for place, text in enumerate(parts[0], 1)}
        return Taught(line, name, kind, joints | extra)
    if " and " in frame:
        return Taught(line, name, kind, fault=f"robtarget of moves in several work objects: {frame}")
    pose = dict(zip(("X", "Y", "Z", "QW", "QX", "QY", "QZ"), [*parts[0], *parts[1]], strict=True))
    return Taught(line, name, kind, pose=pose | ({"frame": frame} if frame else {}))


_SOURCE = Source("rapid", decimal_point=True)


def _postures(text: str, file: str, joints: int | None) -> RawList | None:
    if not is_rapid(text):
        return None
    return postures_of(file, _SOURCE, rapid_points(text), ["RAPID, degrees, decimal point"])


def _targets(text: str, file: str) -> Targets | None:
    if not is_rapid(text):
        return None
    words = ["RAPID, mm and quaternions, decimal point"]
    return Targets(targets_of(file, _SOURCE, rapid_points(text), words), "quaternion")


RAPID = Language(postures=_postures, targets=_targets)
