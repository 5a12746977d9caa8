"""Pairing of postures and positions: by name, or by order where no rows can be shifted; unpaired rows are reported."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeAlias, final

from cellctl.files import InputError, Problem
from cellctl.pendant_import._points import Point, PointList
from cellctl.pendant_import.choices import Choices

Pair: TypeAlias = tuple[Point, Point]
"""A posture and its position."""


@final
@dataclass(frozen=True, slots=True)
class LeftOut:
    """A row of either file that is in no pair, and why."""

    file: str
    line: int
    name: str
    reason: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.name + ': ' if self.name else ''}{self.reason}"


@final
@dataclass(frozen=True, slots=True)
class Pairing:
    """Pairs of posture and position in the order of the positions, rows left out, and how they were paired."""

    pairs: tuple[Pair, ...]
    left_out: tuple[LeftOut, ...]
    decided: tuple[str, ...]

    @classmethod
    def of(cls, pairs: Iterable[Pair], left: Iterable[LeftOut], decided: Iterable[str]) -> Self:
        """A pairing with the rows left out sorted by file and line."""
        return cls(tuple(pairs), tuple(sorted(left, key=lambda row: (row.file, row.line))), tuple(decided))


def left_out(points: PointList, point: Point, reason: str) -> LeftOut:
    """A point that is in no pair."""
    return LeftOut(points.file, point.line, point.name, reason)


Key: TypeAlias = Callable[[str], str]
"""Names of one point have one key."""

_PREFIXED = re.compile(r"(?P<prefix>\D*)(?P<number>\d+)")


def common_key(joints: PointList, positions: PointList) -> tuple[Key, str]:
    """How names are compared: as written, ignoring case, spaces, leading zeros and KRL's X; or by their numbers alone.

    Raises InputError where no name of one list is in the other.
    """
    x_before_names = joints.source.x_before_names

    def plain(name: str) -> str:
        return plain_name(name, x_before_names=x_before_names)

    names = [{plain(point.name) for point in points.points if point.name} for points in (joints, positions)]
    if names[0] & names[1]:
        return plain, ""
    split = [{_PREFIXED.fullmatch(name) for name in each} - {None} for each in names]
    prefixes = [{found["prefix"] for found in each if found} for each in split]
    numbers = [{found["number"] for found in each if found} for each in split]
    if {""} in prefixes and all(len(each) == 1 for each in prefixes) and numbers[0] & numbers[1]:
        return lambda name: re.sub(r"^\D+(?=\d+$)", "", plain(name)), ", by the number in it"
    shown = [", ".join(p.name for p in points.points[:3]) for points in (joints, positions)]
    what = f"no name is in both lists: {shown[0]}, … here, {shown[1]}, … in {positions.file}"
    cure = "correct the names, or --pair order where both lists are complete and in the same order"
    raise InputError(Problem(joints.file, 0, 0, what, cure))


def plain_name(name: str, *, x_before_names: bool) -> str:
    """A name without case, spaces, leading zeros and brackets; x_before_names: without the X in front."""
    text = re.sub(r"\s+", " ", unicodedata.normalize("NFKC", name).casefold().strip())
    text = re.sub(r"(?<=[^\W\d])[\s_.\-\[{]+(?=\d)", "", text).rstrip("]}")
    text = re.sub(r"(?<!\d)(?<!\d[.,])0+(?=\d)", "", text)
    return re.sub(r"^x(?=[^\W\d])", "", text) if x_before_names else text


def are_numbers(points: PointList) -> bool:
    """Whether all given names are numbers."""
    return all(not point.name or plain_name(point.name, x_before_names=False).isdecimal() for point in points.points)


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
    expected = 0 if plain_name(points.points[0].name, x_before_names=False) == "0" else 1
    for point in points.points:
        if not point.name or int(plain_name(point.name, x_before_names=False)) != expected:
            what = f"number {point.name or 'missing'}, where {expected} is next"
            return [Problem(points.file, point.line, 0, what)]
        expected += 1
    return []


def paired(joints: PointList, positions: PointList, choices: Choices) -> Pairing:
    """Postures with their positions: as the user chose, else by name where both have names, else by order.

    Raises InputError where it is not certain which belong together.
    """
    how = choices.pair or ("name" if joints.named and positions.named else "order")
    if how == "name":
        return paired_by_name(joints, positions, repeats=choices.repeats)
    return paired_by_order(joints, positions, asked=choices.pair == "order")
