"""A joint list and a table of positions as the rows of a data set."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from cellctl.files import InputError, Problem
from cellctl.pendant_import.choices import Choices
from cellctl.pendant_import.instrument import of_group, with_times
from cellctl.pendant_import.joint_list import joint_points, joint_texts
from cellctl.pendant_import.pairing import paired
from cellctl.pendant_import.pairs import LeftOut, Pairing
from cellctl.pendant_import.points import Point, PointList, RawList
from cellctl.pendant_import.positions import measured, measured_columns, position_points, position_texts
from cellctl.pendant_import.text import read_text

if TYPE_CHECKING:
    from cellctl.formats.robot import RobotFile


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
    headed = [each for each in lists if each.source == "table" and each.heading_line]
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
    records = tuple(_record(posture, position) for posture, position in pairing.pairs)
    return Imported(records, pairing.left_out, (*stated, *pairing.decided))


def _record(posture: Point, position: Point) -> dict[str, Any]:
    record: dict[str, Any] = {"name": posture.name or position.name} if posture.name or position.name else {}
    record |= {**posture.values, **position.values}
    remark = " ".join(dict.fromkeys(text for text in (posture.remark, position.remark) if text))
    return {**record, "remark": remark} if remark else record


def _decided(points: PointList) -> list[str]:
    return [f"{points.file}: {'; '.join(part for part in points.decided if part)}"]


def _named(row: LeftOut) -> str:
    return f"{row.name}: {row.reason}" if row.name else row.reason
