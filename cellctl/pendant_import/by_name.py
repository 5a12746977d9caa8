"""Postures and positions of the same name: the intersection of both lists; the others are reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from cellctl.files import InputError, Problem
from cellctl.pendant_import.names import Key, common_key
from cellctl.pendant_import.pairs import LeftOut, Pair, Pairing, left_out
from cellctl.pendant_import.points import Point, PointList

_Groups = dict[str, list[Point]]


def paired_by_name(joints: PointList, positions: PointList, *, repeats: bool) -> Pairing:
    """Pairs of one name, in the order of the positions; a list without names is named by its running numbers.

    repeats: several positions of one name are several pairs. Raises InputError where no name is in both lists.
    """
    if not (joints.named or positions.named):
        cure = "--pair order, where both are complete and in the same order"
        raise InputError(Problem(joints.file, 0, 0, "neither this list nor the other has names", cure))
    joints, positions = _numbered(joints), _numbered(positions)
    key, how = common_key(joints, positions)
    first, left = _grouped(joints, key, repeats=False)
    second, more = _grouped(positions, key, repeats=repeats)
    pairs = _pairs(first, second)
    met = {id(point) for pair in pairs for point in pair}
    for points, mine, other, kind in ((joints, first, second, "position"), (positions, second, first, "posture")):
        file = positions.file if points is joints else joints.file
        left += [
            left_out(points, point, point.fault or _alone(other.get(name), kind, file))
            for name, group in mine.items()
            for point in group
            if id(point) not in met
        ]
    example = next(((a, b) for a, b in pairs if a.name != b.name), None)
    as_in = f", as in {example[0].name} = {example[1].name}" if example else ""
    return Pairing.of(pairs, [*left, *more], [f"paired by name{how}{as_in}"])


def _pairs(first: _Groups, second: _Groups) -> list[Pair]:
    return [
        (posture, position)
        for name, group in second.items()
        for position in group
        for posture in first.get(name, ())
        if not (posture.fault or position.fault)
    ]


def _alone(found: Sequence[Point] | None, kind: str, file: str) -> str:
    """Why a good point has no partner."""
    return f"its {kind}, line {found[0].line}, cannot be used" if found else f"no {kind} of this name in {file}"


def _numbered(points: PointList) -> PointList:
    """The list, its points named by their running number where it has no names."""
    if points.named:
        return points
    return replace(points, points=tuple(replace(p, name=str(place)) for place, p in enumerate(points.points, 1)))


def _grouped(points: PointList, key: Key, *, repeats: bool) -> tuple[dict[str, list[Point]], list[LeftOut]]:
    """The usable points by name, and the rows left out. Without `repeats` each name has one point.

    The same numbers a second time are left out; with other numbers both are left out, as it is unknown which are right.
    """
    groups: dict[str, list[Point]] = {}
    left = [left_out(points, point, point.fault or "has no name") for point in points.points if not point.name]
    for point in points.points:
        if point.name:
            groups.setdefault(key(point.name), []).append(point)
    for name, group in groups.items():
        kept, more = _once(points, group)
        left += more
        if len(kept) > 1 and not repeats:
            first, *others = kept
            left += [left_out(points, other, _twice(first)) for other in others]
            kept = [replace(first, fault=_twice(others[0]))]
        groups[name] = kept
    return groups, left


def _once(points: PointList, group: Sequence[Point]) -> tuple[list[Point], list[LeftOut]]:
    """Points of one name without faulty ones (unless all are) and without copies."""
    usable = [point for point in group if not point.fault] or [group[0]]
    left = [left_out(points, point, point.fault) for point in group if point.fault and point is not usable[0]]
    kept: list[Point] = []
    for point in usable:
        same = next((other for other in kept if other.values == point.values), None)
        if same is None:
            kept.append(point)
        else:
            left.append(left_out(points, point, f"the same numbers as line {same.line}"))
    return kept, left


def _twice(other: Point) -> str:
    """Why neither of two rows of one name is used; --repeats states that repeats are intended."""
    cure = "delete the wrong one, or say --repeats" if "X" in other.values else "delete the wrong one"
    return f"on line {other.line} too, with other numbers: {cure}"
