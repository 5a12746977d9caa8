"""The kind of each row of a data set, by its filled cells."""

from __future__ import annotations

from collections.abc import Collection
from typing import Literal, TypeAlias, get_args

from cellctl.files import InputError, Problem
from cellctl.formats.artefact import Artefact
from cellctl.formats.columns import Sieve
from cellctl.formats.dataset import DataSet

Kind: TypeAlias = Literal["sphere", "plane", "socket", "distance", "pose", "position"]
"""What a row measures; distance: from an unknown fixed point (ball-bar, draw-wire)."""

KINDS: tuple[Kind, ...] = get_args(Kind)
"""In the order in which a row's cells are checked."""

NOUNS = {
    "sphere": "touches",
    "plane": "plane touches",
    "socket": "socket visits",
    "distance": "distances",
    "pose": "poses",
    "position": "positions",
}

_ONE = {
    "sphere": "a touch",
    "plane": "a touch on a plane",
    "socket": "a socket visit",
    "distance": "a distance",
    "pose": "a pose",
    "position": "a position",
}

PLACE = ("X", "Y", "Z")
ABC = ("A", "B", "C")
QUATERNION = ("QW", "QX", "QY", "QZ")
_NEEDED: dict[Kind, tuple[str, ...]] = {
    "sphere": ("sphere",),
    "plane": ("plane",),
    "socket": ("socket",),
    "distance": ("anchor", "distance"),
    "pose": PLACE,
    "position": PLACE,
}
_FILLED_BY: dict[Kind, tuple[str, ...]] = {**_NEEDED, "pose": (*ABC, *QUATERNION)}


def measure_of(data: DataSet) -> Kind:
    """The first kind with a filled cell in any row; positions where there is none."""
    return next((kind for kind in KINDS if any(_filled(data, kind))), "position")


def kinds_of(sieve: Sieve, asked: Kind | None) -> list[Kind]:
    """The kind of each row (N,). With `asked` the rows of other kinds are rejected, with this reason."""
    data = sieve.data
    common: Kind = asked or measure_of(data)
    order = KINDS if asked is None else (asked, *(kind for kind in KINDS if kind != asked))
    filled = {kind: _filled(data, kind) for kind in order}
    kinds = [next((kind for kind in order if filled[kind][row]), common) for row in range(len(data))]
    for row, kind in enumerate(kinds):
        if asked is not None and kind != asked:
            sieve.reject(row, f"{_ONE[kind]}, and only {NOUNS[asked]} are asked for")
    return kinds


def reject_zeros(sieve: Sieve, kinds: Collection[Kind]) -> None:
    """Reject the rows that name a zero and are not distances; positions and poses may, if they state its σ."""
    stated = sieve.data.texts("sZero")
    for row, (zero, kind) in enumerate(zip(sieve.data.texts("zero"), kinds, strict=True)):
        if zero and kind != "distance" and not (kind in ("position", "pose") and stated[row]):
            sieve.reject(row, f"zero '{zero}' is of a distance from an anchor, and this is {_ONE[kind]}")


def check_columns(data: DataSet, kinds: Collection[Kind], artefact: Artefact | None) -> None:
    """Raise InputError where rows of these kinds lack a whole column."""
    for kind in [each for each in KINDS if each in kinds]:
        missing = [name for name in _NEEDED[kind] if not data.has(name)]
        if missing:
            what = f"has no column {', '.join(missing)}, which a {kind} needs"
            raise InputError(Problem(data.file, 1, 0, what, f"columns here: {', '.join(data.columns[:12])}"))
        if kind == "pose" and not any(data.has(*names) for names in (ABC, QUATERNION)):
            what = "has no orientation: A, B, C or QW, QX, QY, QZ"
            raise InputError(Problem(data.file, 1, 0, what, "--measure position"))
        if kind == "pose" and all(any(any(data.texts(name)) for name in names) for names in (ABC, QUATERNION)):
            what = "gives the orientation in two ways: A, B, C and QW, QX, QY, QZ"
            raise InputError(Problem(data.file, 1, 0, what, "keep one"))
        if kind == "sphere" and artefact is None and not data.has("radius"):
            what = "has touches on spheres, but neither a column radius nor an artefact says how large these are"
            raise InputError(Problem(data.file, 1, 0, what, "give --artefact FILE (the cell file does)"))


def _filled(data: DataSet, kind: Kind) -> list[bool]:
    """Which rows (N,) have any cell of this kind filled."""
    columns = [data.texts(name) for name in _FILLED_BY[kind] if data.has(name)]
    return [any(cells) for cells in zip(*columns, strict=True)] if columns else [False] * len(data)
