"""Points of a FANUC teach pendant program (.LS), mm and degrees, and the third joint shown against the horizontal.

W, P, R are turns about the fixed X, Y, Z: R = Rz(R) Ry(P) Rx(W) (Basler rc_visard manual, "FANUC XYZ-WPR format"). The
layout is that of published .LS files.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from cellctl.files import InputError, Problem
from cellctl.pendant_import._language import Language, Targets, postures_of, targets_of
from cellctl.pendant_import._points import Point, RawList, Source, Taught, unified
from cellctl.pendant_import.choices import Choices
from cellctl.robot_file import RobotFile

_LS = re.compile(r"^\s*/(?:PROG|POS)\b", re.MULTILINE)
_SECTION = re.compile(r"^\s*/POS\b(?P<body>.*?)(?:^\s*/END\b|\Z)", re.MULTILINE | re.DOTALL)
_POINT = re.compile(r'P\[\s*(?P<number>\d+)\s*(?::\s*"(?P<name>[^"]*)"\s*)?\]\s*\{(?P<body>[^{}]*)(?P<end>\}?)')
_GROUP = re.compile(r"\bGP(?P<number>\d)\s*:")
_FIELD = re.compile(r"\b(?P<label>U[FT]|[XYZWPR]|[JE]\d)\s*[:=]\s*(?P<value>[^,\s]+)[ \t]*(?P<unit>mm|deg)?")
_POSE = {"X": "X", "Y": "Y", "Z": "Z", "A": "R", "B": "P", "C": "W"}
"""A, B, C as in a data set → the field: Rz(A) Ry(B) Rx(C) = Rz(R) Ry(P) Rx(W)."""


def is_fanuc(text: str) -> bool:
    """Whether `text` is a teach pendant program."""
    return _LS.search(text) is not None


def fanuc_points(text: str) -> tuple[list[Taught], list[str]]:
    """The points in the order of the file, and what was decided. Of each point the first motion group is taken.

    A point is named by its comment, where all points have one and all are different, else `P[n]`, and the comment is
    its remark.
    """
    code = unified(text)
    found = [
        (match, 1 + code.count("\n", 0, section.start("body") + match.start()))
        for section in _SECTION.finditer(code)
        for match in _POINT.finditer(section["body"])
    ]
    names = [match["name"] or "" for match, _ in found]
    commented = bool(names) and all(names) and len(set(names)) == len(names)
    points = [
        _point(line, name.strip(), match)
        if commented
        else replace(_point(line, f"P[{match['number']}]", match), remark=name.strip())
        for (match, line), name in zip(found, names, strict=True)
    ]
    groups = sorted({number for match, _ in found for number in _GROUP.findall(match["body"])} - {"1"})
    decided = ["FANUC .LS, mm and degrees, decimal point"]
    if groups:
        decided.append(f"motion group 1 only, not {', '.join(f'GP{number}' for number in groups)}")
    return points, decided


def _point(line: int, name: str, match: re.Match[str]) -> Taught:
    if not match["end"]:
        return Taught(line, name, "P[]", fault="does not end: '}' is missing")
    fields = {field["label"]: field for field in _FIELD.finditer(_first_group(match["body"]))}
    untaught = [label for label, field in fields.items() if "*" in field["value"]]
    if untaught:
        return Taught(line, name, "P[]", fault=f"{untaught[0]} is {fields[untaught[0]]['value']}: not taught")
    if "X" in fields:
        return _cartesian(line, name, fields)
    joints = {label: field["value"] for label, field in fields.items() if label[0] in "JE"}
    linear = [label for label in joints if label[0] == "J" and fields[label]["unit"] != "deg"]
    if linear or not joints:
        what = f"{linear[0]} is not in degrees" if linear else "holds neither joints nor X, Y, Z"
        return Taught(line, name, "P[]", fault=what)
    return Taught(line, name, "P[]", joints)


def _first_group(body: str) -> str:
    """The text of motion group 1, or all where no group is named."""
    starts = [*_GROUP.finditer(body)]
    ends = [start.start() for start in starts][1:] + [len(body)] * bool(starts)
    groups = [body[start.end() : end] for start, end in zip(starts, ends, strict=True) if start["number"] == "1"]
    return groups[0] if groups else "" if starts else body


def _cartesian(line: int, name: str, fields: Mapping[str, re.Match[str]]) -> Taught:
    kind = "P[]"
    missing = [label for label in _POSE.values() if label not in fields]
    if missing:
        return Taught(line, name, kind, fault=f"{', '.join(missing)} missing")
    pose = {column: fields[label]["value"] for column, label in _POSE.items()}
    frame = {"frame": f"UF {fields['UF']['value']}"} if "UF" in fields else {}
    return Taught(line, name, kind, pose=pose | frame)


_CURE = (
    "--j3 horizontal adds J2 to J3 (readings of a FANUC pendant or program), --j3 arm takes J3 as the angle between "
    "the arms"
)


def between_the_arms(
    raw: RawList, points: Sequence[Point], choices: Choices, robot: RobotFile | None
) -> tuple[list[Point], str]:
    """The points with J3 as the angle between the arms, and what was decided.

    A robot file states with `controller_j3: horizontal` in its source that its J3 is that angle and the controller's is
    not. Raises InputError where the list is a FANUC's, or the robot file states this, and it is not certain what J3 is.
    """
    stated = bool(robot and robot.source and robot.source.controller_j3 == "horizontal")
    shown = choices.j3 == "horizontal" or (choices.j3 is None and stated and raw.source.j3_from_horizontal)
    if shown:
        how = "--j3" if choices.j3 else "the robot file"
        return [_added(point) for point in points], f"J3 counted from the horizontal, as {how} says: J2 added to it"
    if choices.j3 == "arm":
        return list(points), "J3 is the angle between the arms, as --j3 says"
    if raw.source.j3_from_horizontal:
        what = (
            "its J3 counts from the horizontal, as FANUC's controllers show it; no robot file says what a model needs"
        )
        cure = f"--robot with `controller_j3: horizontal` in its source, or {_CURE}"
        raise InputError(Problem(raw.file, 0, 0, what, cure))
    if stated and any(not point.fault for point in points):
        what = "does J3 count from the horizontal, as this robot's controller shows it, or from the arm before it?"
        raise InputError(Problem(raw.file, raw.heading_line, 0, what, _CURE))
    return list(points), ""


def _added(point: Point) -> Point:
    letter = next((letter for letter in "Aq" if f"{letter}3" in point.values), "")
    if point.fault or not letter:
        return point
    total = float(point.values[f"{letter}3"]) + float(point.values[f"{letter}2"])
    return replace(point, values={**point.values, f"{letter}3": round(total, 9)})


_SOURCE = Source("fanuc", decimal_point=True, j3_from_horizontal=True)


def _postures(text: str, file: str, joints: int | None) -> RawList | None:
    if not is_fanuc(text):
        return None
    return postures_of(file, _SOURCE, *fanuc_points(text))


def _targets(text: str, file: str) -> Targets | None:
    if not is_fanuc(text):
        return None
    points, decided = fanuc_points(text)
    return Targets(targets_of(file, _SOURCE, points, [*decided, "W, P, R as C, B, A"]), "abc")


FANUC = Language(postures=_postures, targets=_targets)
