"""Which posture belongs to which position: by name, or by order where nothing can be out of step."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias, final

from cellctl.files import InputError, Problem
from cellctl.formats.pendant.choices import Choices
from cellctl.formats.pendant.points import Point, PointList

Pair: TypeAlias = tuple[Point, Point]
Key: TypeAlias = Callable[[str], str]

_PREFIXED = re.compile(r"(?P<prefix>\D*)(?P<number>\d+)")


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
    """Pairs of posture and position in the order of the positions, what is in none, and how they were paired."""

    pairs: tuple[Pair, ...]
    left_out: tuple[LeftOut, ...]
    decided: tuple[str, ...]


def paired(joints: PointList, positions: PointList, choices: Choices) -> Pairing:
    """Postures with their positions. Raises InputError where it is not certain which belong together."""
    how = choices.pair or ("name" if joints.named and positions.named else "order")
    return _by_name(joints, positions, choices) if how == "name" else _by_order(joints, positions, choices)


def _by_name(joints: PointList, positions: PointList, choices: Choices) -> Pairing:
    if not (joints.named or positions.named):
        what = "neither this list nor the other has names"
        raise InputError(
            Problem(joints.file, 0, 0, what, "--pair order, where both are complete and in the same order")
        )
    joints, positions = _numbered(joints), _numbered(positions)
    key, how = _key(joints, positions)
    first, left = _grouped(joints, key, repeats=False)
    second, more = _grouped(positions, key, repeats=choices.repeats)
    left += more
    pairs = []
    for name, points in second.items():
        posture = first.get(name)
        for point in points:
            if posture is None:
                left.append(_left(positions, point, point.fault or f"no posture of this name in {joints.file}"))
            elif point.fault or posture[0].fault:
                left.append(
                    _left(positions, point, point.fault or f"its posture, line {posture[0].line}, cannot be used")
                )
            else:
                pairs.append((posture[0], point))
    met = {id(posture) for posture, _ in pairs}
    left += [
        _left(joints, point, point.fault or _without_position(second.get(name), positions.file))
        for name, (point,) in first.items()
        if id(point) not in met
    ]
    example = next(((a, b) for a, b in pairs if a.name != b.name), None)
    as_in = f", as in {example[0].name} = {example[1].name}" if example else ""
    return Pairing(tuple(pairs), _sorted(left), (f"paired by name{how}{as_in}",))


def _without_position(found: Sequence[Point] | None, file: str) -> str:
    return f"its position, line {found[0].line}, cannot be used" if found else f"no position of this name in {file}"


def _numbered(points: PointList) -> PointList:
    """The list, its points named by their running number where it has no names."""
    if points.named:
        return points
    return replace(points, points=tuple(replace(p, name=str(place)) for place, p in enumerate(points.points, 1)))


def _key(joints: PointList, positions: PointList) -> tuple[Key, str]:
    """How names are compared: as written, but for case, spaces, leading zeros and KRL's X; or by their numbers alone.

    Raises InputError where no name of one list is in the other.
    """
    krl = joints.source == "krl"

    def plain(name: str) -> str:
        return _plain(name, krl=krl)

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


def _plain(name: str, *, krl: bool) -> str:
    text = re.sub(r"\s+", " ", unicodedata.normalize("NFKC", name).casefold().strip())
    text = re.sub(r"(?<=[^\W\d])[\s_.\-\[]+(?=\d)", "", text).rstrip("]")
    text = re.sub(r"(?<!\d)(?<!\d[.,])0+(?=\d)", "", text)
    return re.sub(r"^x(?=[^\W\d])", "", text) if krl else text


def _grouped(points: PointList, key: Key, *, repeats: bool) -> tuple[dict[str, list[Point]], list[LeftOut]]:
    """The usable points by name, and what is not one of them. Without `repeats` each name has one point.

    The same numbers a second time are left out; other numbers leave both out, since nobody knows which are right.
    """
    groups: dict[str, list[Point]] = {}
    left = [_left(points, point, point.fault or "has no name") for point in points.points if not point.name]
    for point in points.points:
        if point.name:
            groups.setdefault(key(point.name), []).append(point)
    for name, group in groups.items():
        kept, more = _once(points, group)
        left += more
        if len(kept) > 1 and not repeats:
            first, *others = kept
            left += [_left(points, other, _twice(first)) for other in others]
            kept = [replace(first, fault=_twice(others[0]))]
        groups[name] = kept
    return groups, left


def _once(points: PointList, group: Sequence[Point]) -> tuple[list[Point], list[LeftOut]]:
    """Points of one name without faulty ones (unless all are) and without copies."""
    usable = [point for point in group if not point.fault] or [group[0]]
    left = [_left(points, point, point.fault) for point in group if point.fault and point is not usable[0]]
    kept: list[Point] = []
    for point in usable:
        same = next((other for other in kept if other.values == point.values), None)
        if same is None:
            kept.append(point)
        else:
            left.append(_left(points, point, f"the same numbers as line {same.line}"))
    return kept, left


def _twice(other: Point) -> str:
    """Why neither of two rows of one name is used; measured twice on purpose is what --repeats says."""
    cure = "delete the wrong one, or say --repeats" if "X" in other.values else "delete the wrong one"
    return f"on line {other.line} too, with other numbers: {cure}"


def _left(points: PointList, point: Point, reason: str) -> LeftOut:
    return LeftOut(points.file, point.line, point.name, reason)


def _sorted(left: Iterable[LeftOut]) -> tuple[LeftOut, ...]:
    return tuple(sorted(left, key=lambda row: (row.file, row.line)))


def _by_order(joints: PointList, positions: PointList, choices: Choices) -> Pairing:
    """Row by row. A row that cannot be used keeps its place, so that those after it stay in step."""
    asked = choices.pair == "order"
    doubts = _out_of_step(joints, positions)
    if len(joints.points) != len(positions.points):
        raise InputError(_uneven(joints, positions, doubts))
    if doubts and not asked:
        raise InputError([*doubts, _not_certain(joints)])
    pairs, left = [], []
    for place, (posture, position) in enumerate(zip(joints.points, positions.points, strict=True), 1):
        if posture.fault or position.fault:
            left.append(_left(joints, posture, posture.fault or f"its position, line {position.line}, cannot be used"))
            left.append(
                _left(positions, position, position.fault or f"its posture, line {posture.line}, cannot be used")
            )
        else:
            pairs.append((replace(posture, name=posture.name or position.name or str(place)), position))
    decided = [f"paired by order, {len(joints.points)} rows in each list"]
    if asked:
        decided += [f"in doubt: {doubt}" for doubt in doubts]
    return Pairing(tuple(pairs), _sorted(left), tuple(decided))


def _uneven(joints: PointList, positions: PointList, doubts: Sequence[Problem]) -> list[Problem]:
    unusable = sum(bool(point.fault) for point in joints.points)
    among = f" ({unusable} that cannot be used among them)" if unusable else ""
    what = f"{_count(joints, 'posture')}{among}, but {_count(positions, 'position')} in {positions.file}"
    cures = ["find the row that is missing or there twice; from there on every pair would be a wrong one"]
    if joints.named != positions.named and _numbers(joints if joints.named else positions):
        cures.append("--pair name, where number n means the n-th row of the other list")
    return [Problem(joints.file, 0, 0, what, "; or ".join(cures)), *doubts]


def _count(points: PointList, what: str) -> str:
    return f"{len(points.points)} {what}{'s' * (len(points.points) != 1)}"


def _not_certain(joints: PointList) -> Problem:
    cure = "correct the lists, or say --pair order where all is right as it is"
    return Problem(joints.file, 0, 0, "would be paired row by row, and that is not certain", cure)


def _out_of_step(joints: PointList, positions: PointList) -> list[Problem]:
    """Signs that rows may be out of step: numbers with gaps, a row that looks typed twice, names that differ."""
    doubts = []
    if joints.named != positions.named:
        doubts += _gaps(joints if joints.named else positions)
    rows = list(zip(positions.points, positions.points[1:], strict=False))
    postures = list(zip(joints.points, joints.points[1:], strict=False))
    for place, (one, other) in enumerate(rows):
        moved = place >= len(postures) or postures[place][0].values != postures[place][1].values
        if one.values == other.values and not one.fault and moved:
            doubts.append(Problem(positions.file, other.line, 0, f"the same numbers as line {one.line}: typed twice?"))
    if joints.named and positions.named:
        doubts += _misnamed(joints, positions)
    return doubts


def _misnamed(joints: PointList, positions: PointList) -> list[Problem]:
    key, _ = _key_or_none(joints, positions)
    if key is None:
        return []
    both = zip(joints.points, positions.points, strict=False)
    differ = [(a, b) for a, b in both if a.name and b.name and key(a.name) != key(b.name)]
    if not differ:
        return []
    first, other = differ[0]
    what = (
        f"{len(differ)} pairs bear different names, first {other.name} with {first.name} ({joints.file}:{first.line})"
    )
    return [Problem(positions.file, other.line, 0, what)]


def _key_or_none(joints: PointList, positions: PointList) -> tuple[Key | None, str]:
    try:
        return _key(joints, positions)
    except InputError:
        return None, ""


def _gaps(points: PointList) -> list[Problem]:
    """Where numbers (1, 2, 3, …) do not go on as the rows do."""
    if not _numbers(points):
        return []
    expected = int(_plain(points.points[0].name, krl=False) or 1)
    for point in points.points:
        if not point.name or int(_plain(point.name, krl=False)) != expected:
            what = f"number {point.name or 'missing'}, where {expected} is next"
            return [Problem(points.file, point.line, 0, what)]
        expected += 1
    return []


def _numbers(points: PointList) -> bool:
    return all(not point.name or _plain(point.name, krl=False).isdecimal() for point in points.points)
