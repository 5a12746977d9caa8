"""Postures and positions paired row by row, where nothing shows that the rows may be shifted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cellctl.files import InputError, Problem
from cellctl.pendant_import.names import are_numbers, common_key, plain_name
from cellctl.pendant_import.pairs import Pairing, left_out
from cellctl.pendant_import.points import Point, PointList


def paired_by_order(joints: PointList, positions: PointList, *, asked: bool) -> Pairing:
    """Row by row. A row that cannot be used keeps its place, so that the pairs after it do not shift.

    asked: the user asks for it, and reasons against it are only reported. Otherwise they raise InputError, as different
    counts always do.
    """
    reasons = _out_of_step(joints, positions)
    if len(joints.points) != len(positions.points):
        raise InputError(_uneven(joints, positions, reasons))
    if reasons and not asked:
        cure = "correct the lists, or say --pair order where all is right as it is"
        raise InputError([Problem(joints.file, 0, 0, "may be out of step with the positions", cure), *reasons])
    pairs, left = [], []
    for place, (posture, position) in enumerate(zip(joints.points, positions.points, strict=True), 1):
        if posture.fault or position.fault:
            left.append(left_out(joints, posture, posture.fault or _unusable("position", position)))
            left.append(left_out(positions, position, position.fault or _unusable("posture", posture)))
        else:
            pairs.append((replace(posture, name=posture.name or position.name or str(place)), position))
    in_doubt = [f"in doubt: {doubt}" for doubt in reasons]
    return Pairing.of(pairs, left, [f"paired by order, {len(joints.points)} rows in each list", *in_doubt])


def _unusable(kind: str, point: Point) -> str:
    return f"its {kind}, line {point.line}, cannot be used"


def _uneven(joints: PointList, positions: PointList, reasons: Sequence[Problem]) -> list[Problem]:
    unusable = sum(bool(point.fault) for point in joints.points)
    among = f" ({unusable} that cannot be used among them)" if unusable else ""
    what = f"{_count(joints, 'posture')}{among}, but {_count(positions, 'position')} in {positions.file}"
    cures = ["find the row that is missing or there twice; from there on every pair would be a wrong one"]
    if joints.named != positions.named and are_numbers(joints if joints.named else positions):
        cures.append("--pair name, where number n means the n-th row of the other list")
    return [Problem(joints.file, 0, 0, what, "; or ".join(cures)), *reasons]


def _count(points: PointList, what: str) -> str:
    return f"{len(points.points)} {what}{'s' * (len(points.points) != 1)}"


def _out_of_step(joints: PointList, positions: PointList) -> list[Problem]:
    """Signs that rows may be shifted: numbers with gaps, a row that may be typed twice, names that differ."""
    if joints.named and positions.named:
        reasons = _misnamed(joints, positions)
    elif joints.named or positions.named:
        reasons = _gaps(joints if joints.named else positions)
    else:
        reasons = []
    return [*reasons, *_copies(joints, positions)]


def _copies(joints: PointList, positions: PointList) -> list[Problem]:
    """Positions equal to the one before, with different joints."""
    reasons = []
    for place, (one, other) in enumerate(zip(positions.points, positions.points[1:], strict=False)):
        still = joints.points[place : place + 2]
        moved = len(still) < 2 or still[0].values != still[1].values
        if _place(one) == _place(other) and not one.fault and moved:
            reasons.append(Problem(positions.file, other.line, 0, f"the same numbers as line {one.line}: typed twice?"))
    return reasons


def _place(point: Point) -> list[object]:
    return [point.values.get(axis) for axis in "XYZ"]


def _misnamed(joints: PointList, positions: PointList) -> list[Problem]:
    """Rows of the same place with different names, where names of one list are in the other."""
    try:
        key, _ = common_key(joints, positions)
    except InputError:
        return []
    both = zip(joints.points, positions.points, strict=False)
    differ = [(a, b) for a, b in both if a.name and b.name and key(a.name) != key(b.name)]
    if not differ:
        return []
    first, other = differ[0]
    where = f"first {other.name} with {first.name} ({joints.file}:{first.line})"
    return [Problem(positions.file, other.line, 0, f"{len(differ)} pairs bear different names, {where}")]


def _gaps(points: PointList) -> list[Problem]:
    """Gaps in the numbers, which count the rows from 1 (or 0)."""
    if not are_numbers(points):
        return []
    expected = 0 if plain_name(points.points[0].name, krl=False) == "0" else 1
    for point in points.points:
        if not point.name or int(plain_name(point.name, krl=False)) != expected:
            what = f"number {point.name or 'missing'}, where {expected} is next"
            return [Problem(points.file, point.line, 0, what)]
        expected += 1
    return []
