"""The table of row kinds, and the kind of each row of a data set, by its filled cells."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Literal, TypeAlias, final

from cellctl.calibration import Measured, PlaneRows, PoseRows, PositionRows, SocketRows, TouchRows
from cellctl.files import InputError, Problem
from cellctl.formats.artefact import Artefact
from cellctl.formats.dataset import DataSet, Sieve
from cellctl.formats.measurements._rows import (
    Planes,
    Poses,
    Positions,
    Reaches,
    Reading,
    Sockets,
    check_orientation,
    check_radii,
)
from cellctl.formats.measurements.columns import ABC, PLACE, QUATERNION
from cellctl.robot_file import RobotFile

Kind: TypeAlias = str
"""The name of a row kind, a key of `KINDS`: `sphere`, `position`."""


@final
@dataclass(frozen=True, kw_only=True)
class RowKind:
    """What a data set has of one kind of rows.

    rows: the class of their blocks. read: their cells, at the rows of these indices alone. one, many: such rows in
    messages. columns: the data set needs all of these. filled_by: a row with any of these cells is of this kind; empty:
    `columns`. point: the one of `columns` that names the row's fixed point. numbers: how many are measured in a row.
    zero: whether a row may name an unknown zero of its length. touching: whether the tool is pressed against
    something, so that it bends. check: raises InputError where the data set cannot have such rows at all.
    """

    rows: type[Measured]
    read: Callable[[Sieve, RobotFile, Collection[int], Artefact | None], Reading]
    one: str
    many: str
    columns: tuple[str, ...]
    filled_by: tuple[str, ...] = ()
    point: str = ""
    numbers: int = 1
    zero: Literal["none", "with σ", "free"] = "none"
    touching: bool = False
    check: Callable[[DataSet, Artefact | None], None] | None = None


KINDS: dict[Kind, RowKind] = {
    "sphere": RowKind(
        rows=TouchRows,
        read=Reaches.of_touches,
        one="a touch",
        many="touches",
        columns=("sphere",),
        point="sphere",
        touching=True,
        check=check_radii,
    ),
    "plane": RowKind(
        rows=PlaneRows,
        read=Planes.of,
        one="a touch on a plane",
        many="plane touches",
        columns=("plane",),
        point="plane",
        touching=True,
    ),
    "socket": RowKind(
        rows=SocketRows,
        read=Sockets.of,
        one="a socket visit",
        many="socket visits",
        columns=("socket",),
        point="socket",
        numbers=3,
    ),
    "distance": RowKind(
        rows=TouchRows,
        read=Reaches.of_distances,
        one="a distance",
        many="distances",
        columns=("anchor", "distance"),
        point="anchor",
        zero="free",
    ),
    "pose": RowKind(
        rows=PoseRows,
        read=Poses.of,
        one="a pose",
        many="poses",
        columns=PLACE,
        filled_by=(*ABC, *QUATERNION),
        numbers=6,
        zero="with σ",
        check=check_orientation,
    ),
    "position": RowKind(
        rows=PositionRows,
        read=Positions.of,
        one="a position",
        many="positions",
        columns=PLACE,
        numbers=3,
        zero="with σ",
    ),
}
"""In the order in which a row's cells are checked; distance: from an unknown fixed point (ball-bar, draw-wire). Kinds
of other packages follow.
"""


def noun_of(measure: str) -> str:
    """The noun for rows of the kind `measure` in messages; of several kinds, joined by `+`: rows."""
    return KINDS[measure].many if measure in KINDS else "rows"


def measure_of(data: DataSet) -> Kind:
    """The first kind with a filled cell in any row; positions where there is none."""
    return next((kind for kind in KINDS if any(_filled(data, kind))), "position")


def kinds_of(sieve: Sieve, asked: Kind | None) -> list[Kind]:
    """The kind of each row (N,). With `asked` the rows of other kinds are rejected, with this reason."""
    data = sieve.data
    common: Kind = asked or measure_of(data)
    order = list(KINDS) if asked is None else [asked, *(kind for kind in KINDS if kind != asked)]
    filled = {kind: _filled(data, kind) for kind in order}
    kinds = [next((kind for kind in order if filled[kind][row]), common) for row in range(len(data))]
    for row, kind in enumerate(kinds):
        if asked is not None and kind != asked:
            sieve.reject(row, f"{KINDS[kind].one}, and only {KINDS[asked].many} are asked for")
    return kinds


def reject_zeros(sieve: Sieve, kinds: Collection[Kind]) -> None:
    """Reject the rows that name a zero which their kind does not have, or not without its σ."""
    stated = sieve.data.texts("sZero")
    for row, (zero, kind) in enumerate(zip(sieve.data.texts("zero"), kinds, strict=True)):
        allowed = KINDS[kind].zero
        if zero and allowed != "free" and not (allowed == "with σ" and stated[row]):
            sieve.reject(row, f"zero '{zero}' is of a distance from an anchor, and this is {KINDS[kind].one}")


def check_columns(data: DataSet, kinds: Collection[Kind], artefact: Artefact | None) -> None:
    """Raise InputError where rows of these kinds lack a whole column."""
    for name, kind in [(name, kind) for name, kind in KINDS.items() if name in kinds]:
        missing = [column for column in kind.columns if not data.has(column)]
        if missing:
            what = f"has no column {', '.join(missing)}, which a {name} needs"
            raise InputError(Problem(data.file, 1, 0, what, f"columns here: {', '.join(data.columns[:12])}"))
        if kind.check:
            kind.check(data, artefact)


def _filled(data: DataSet, kind: Kind) -> list[bool]:
    """Which rows (N,) have any cell of this kind filled."""
    columns = [data.texts(name) for name in KINDS[kind].filled_by or KINDS[kind].columns if data.has(name)]
    return [any(cells) for cells in zip(*columns, strict=True)] if columns else [False] * len(data)
