"""Cartesian points of a robot program or of a table as targets for `cellctl compensate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from cellctl.files import InputError, Problem
from cellctl.pendant_import.choices import Choices
from cellctl.pendant_import.importing import Imported
from cellctl.pendant_import.orientation import COLUMNS, oriented
from cellctl.pendant_import.pairs import LeftOut
from cellctl.pendant_import.points import Point, PointList
from cellctl.pendant_import.positions import XYZ, position_points, position_texts
from cellctl.pendant_import.programs import Targets, program_targets
from cellctl.pendant_import.text import read_text
from cellctl.pendant_import.values import in_mm, read_values

_MOST_NAMED = 10
_OF_TABLES = ("orientation", "unit", "decimal", "columns", "group", "coverage")
"""Choices that no program leaves open."""


def imported_targets(path: Path, choices: Choices) -> Imported:
    """The rows of a target file: name, X, Y, Z in mm, and A, B, C in degrees or QW…QZ.

    Raises InputError where the orientation, the unit or the frame is not certain, or no point is left.
    """
    file = str(path)
    text = read_text(path)
    found = program_targets(text, file)
    points = _of_table(text, file, choices) if found is None else _of_program(found, choices)
    chosen = _in_one_frame(points, choices)
    left = tuple(LeftOut(file, point.line, point.name, point.fault) for point in chosen.points if point.fault)
    records = tuple(_record(point) for point in chosen.points if not point.fault)
    if not records:
        some = [Problem(file, row.line, 0, row.reason) for row in left[:_MOST_NAMED]]
        cure = "give the file with the numbers of the points (of a KRL program: its .dat)"
        raise InputError([Problem(file, 0, 0, "holds no Cartesian point that can be used", cure), *some])
    return Imported(records, left, (f"{file}: {'; '.join(part for part in chosen.decided if part)}",))


def _of_program(found: Targets, choices: Choices) -> PointList:
    given = [name for name in _OF_TABLES if getattr(choices, name)]
    if given:
        what = "is a robot program: the language says what its numbers mean"
        raise InputError(Problem(found.raw.file, 0, 0, what, f"leave --{', --'.join(given)} out"))
    read = read_values(found.raw, [*XYZ, *COLUMNS[found.orientation], *found.postures], None)
    points = tuple(_in_mm(point, found.length) for point in read.points)
    return oriented(replace(read, points=points), found.orientation, {})


def _in_mm(point: Point, length: str) -> Point:
    values = {name: in_mm(value, length) if name in XYZ else value for name, value in point.values.items()}
    return point if point.fault else replace(point, values=values)


def _of_table(text: str, file: str, choices: Choices) -> PointList:
    if choices.orientation is None:
        cure = "give columns A, B, C (deg) and --orientation abc; or quaternion, fixed-xyz, euler-xyz, rotation-vector"
        raise InputError(
            Problem(file, 0, 0, "a target needs an orientation, and --orientation does not say which", cure)
        )
    return position_points(position_texts(text, file, choices), choices)


def _in_one_frame(points: PointList, choices: Choices) -> PointList:
    """The points of the frame that the user chose, or of the only one. Raises InputError where there are several."""
    usable = [point for point in points.points if not point.fault]
    frames = sorted({str(point.values["frame"]) for point in usable if "frame" in point.values})
    if choices.frame is not None:
        return _of_frame(points, frames, choices.frame)
    if len(frames) > 1:
        what = f"its points are in different frames: {', '.join(frames)}"
        raise InputError(Problem(points.file, 0, 0, what, f"--frame '{frames[0]}' takes the points of one"))
    unknown = [point.name or f"line {point.line}" for point in usable if "frame" not in point.values]
    decided = [f"all in {frames[0]}, which has to be the model's frame"] if frames and not unknown else []
    if frames and unknown:
        some = ", ".join(unknown[:_MOST_NAMED]) + (", …" if len(unknown) > _MOST_NAMED else "")
        decided = [f"in {frames[0]}, which has to be the model's frame; no frame is named for {some}"]
    if not frames:
        decided = ["the file names no frame: it has to be the model's"]
    kept = tuple(replace(point, values=_without_frame(point.values)) for point in points.points)
    return replace(points, points=kept, decided=(*points.decided, *decided))


def _of_frame(points: PointList, frames: list[str], frame: str) -> PointList:
    if frame not in frames:
        here = f"frames here: {', '.join(frames)}" if frames else "the file names no frames: leave --frame out"
        raise InputError(Problem(points.file, 0, 0, f"has no point in frame '{frame}'", here))
    kept = tuple(
        replace(point, values=_without_frame(point.values))
        if point.values.get("frame") == frame
        else replace(point, fault=point.fault or f"is in {point.values.get('frame', 'a frame that is not named')}")
        for point in points.points
    )
    words = f"points in {frame}, which has to be the model's frame"
    return replace(points, points=kept, decided=(*points.decided, words))


def _without_frame(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name != "frame"}


def _record(point: Point) -> dict[str, Any]:
    record: dict[str, Any] = {"name": point.name} if point.name else {}
    return record | dict(point.values) | ({"remark": point.remark} if point.remark else {})
