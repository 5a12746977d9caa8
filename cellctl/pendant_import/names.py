"""Rules for names of the same point, as typed by people from a pendant."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable
from typing import TypeAlias

from cellctl.files import InputError, Problem
from cellctl.pendant_import.points import PointList

Key: TypeAlias = Callable[[str], str]
"""Names of one point have one key."""

_PREFIXED = re.compile(r"(?P<prefix>\D*)(?P<number>\d+)")


def common_key(joints: PointList, positions: PointList) -> tuple[Key, str]:
    """How names are compared: as written, ignoring case, spaces, leading zeros and KRL's X; or by their numbers alone.

    Raises InputError where no name of one list is in the other.
    """
    krl = joints.source == "krl"

    def plain(name: str) -> str:
        return plain_name(name, krl=krl)

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


def plain_name(name: str, *, krl: bool) -> str:
    """A name without case, spaces, leading zeros and brackets; krl: without the X that a KRC adds in front."""
    text = re.sub(r"\s+", " ", unicodedata.normalize("NFKC", name).casefold().strip())
    text = re.sub(r"(?<=[^\W\d])[\s_.\-\[{]+(?=\d)", "", text).rstrip("]}")
    text = re.sub(r"(?<!\d)(?<!\d[.,])0+(?=\d)", "", text)
    return re.sub(r"^x(?=[^\W\d])", "", text) if krl else text


def are_numbers(points: PointList) -> bool:
    """Whether all given names are numbers."""
    return all(not point.name or plain_name(point.name, krl=False).isdecimal() for point in points.points)
