"""A joint list and a table of positions as rows of a data set; points of a program or table as targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

from cellctl.files import InputError, Problem
from cellctl.pendant_import._instrument import of_group, with_times
from cellctl.pendant_import._joint_list import joint_points, joint_texts
from cellctl.pendant_import._language import Targets
from cellctl.pendant_import._pairing import LeftOut, Pairing, paired
from cellctl.pendant_import._points import TABLE, Point, PointList, RawList, in_mm, read_text, read_values
from cellctl.pendant_import._positions import (
    COLUMNS,
    XYZ,
    measured,
    measured_columns,
    oriented,
    position_points,
    position_texts,
)
from cellctl.pendant_import._programs import program_targets
from cellctl.pendant_import.choices import Choices
from cellctl.robot_file import RobotFile


@final
@dataclass(frozen=True, slots=True)
class Imported:
    """Rows of a data set (`name`, joints, X, Y, Z, …), the rows of both files left out, and the decisions made."""

    records: tuple[Mapping[str, Any], ...]
    left_out: tuple[LeftOut, ...]
    decided: tuple[str, ...]


def imported(joints: Path, positions: Path | None, choices: Choices, robot: RobotFile | None = None) -> Imported:
    """The rows that a joint list and a table of positions make; without `positions` the joint table holds X, Y, Z too.

    Raises InputError with every error of both files where the input is ambiguous, or no row is left.
    """
    if positions is None:
        result = _of_one(joints, choices, robot)
    else:
        postures, points = _both(joints, positions, choices, robot)
        result = _of_pairing(paired(postures, points, choices), [*_decided(postures), *_decided(points)])
    if result.records:
        return result
    some = [Problem(row.file, row.line, 0, _named(row)) for row in result.left_out[:20]]
    raise InputError([Problem(str(joints), 0, 0, "gives no row that can be used"), *some])


def _of_one(path: Path, choices: Choices, robot: RobotFile | None) -> Imported:
    wanted = measured_columns(choices)
    raw = joint_texts(read_text(path), str(path), choices, robot, wanted)
    raw = with_times(of_group(raw, choices))
    _check_columns(choices, raw)
    points = measured(raw, joint_points(raw, choices, robot, wanted), choices)
    usable = [(point, point) for point in points.points if not point.fault]
    left = tuple(LeftOut(points.file, point.line, point.name, point.fault) for point in points.points if point.fault)
    return _of_pairing(Pairing(tuple(usable), left, ()), _decided(points))


def _both(joints: Path, positions: Path, choices: Choices, robot: RobotFile | None) -> tuple[PointList, PointList]:
    """Both lists, or the errors of both at once."""
    postures: tuple[RawList, PointList] | None = None
    points: tuple[RawList, PointList] | None = None
    problems: list[Problem] = []
    try:
        raw = joint_texts(read_text(joints), str(joints), choices, robot, ())
        postures = raw, joint_points(raw, choices, robot)
    except InputError as error:
        problems += error.problems
    try:
        raw = position_texts(read_text(positions), str(positions), choices)
        points = raw, position_points(raw, choices)
    except InputError as error:
        problems += error.problems
    if postures is None or points is None:
        raise InputError(problems)
    _check_columns(choices, postures[0], points[0])
    return postures[1], points[1]


def _check_columns(choices: Choices, *lists: RawList) -> None:
    """Refuse a column that the user named and that no file has; only a table with headings can have it."""
    headed = [each for each in lists if each.source is TABLE and each.heading_line]
    known = {name for each in headed for point in each.points for name in point.texts}
    known |= {"name" for each in headed for point in each.points if point.name}
    lacking = {name: source for name, source in choices.columns.items() if name not in known}
    if lacking:
        raise InputError(
            Problem(
                "--columns", 0, 0, f"no file has a column '{source}' for {name}", "give a heading as the file has it"
            )
            for name, source in lacking.items()
        )


def _of_pairing(pairing: Pairing, stated: Sequence[str]) -> Imported:
    records = tuple(_row_record(posture, position) for posture, position in pairing.pairs)
    return Imported(records, pairing.left_out, (*stated, *pairing.decided))


def _row_record(posture: Point, position: Point) -> dict[str, Any]:
    record: dict[str, Any] = {"name": posture.name or position.name} if posture.name or position.name else {}
    record |= {**posture.values, **position.values}
    remark = " ".join(dict.fromkeys(text for text in (posture.remark, position.remark) if text))
    return {**record, "remark": remark} if remark else record


def _decided(points: PointList) -> list[str]:
    return [f"{points.file}: {'; '.join(part for part in points.decided if part)}"]


def _named(row: LeftOut) -> str:
    return f"{row.name}: {row.reason}" if row.name else row.reason


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
    records = tuple(_target_record(point) for point in chosen.points if not point.fault)
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


def _target_record(point: Point) -> dict[str, Any]:
    record: dict[str, Any] = {"name": point.name} if point.name else {}
    return record | dict(point.values) | ({"remark": point.remark} if point.remark else {})
