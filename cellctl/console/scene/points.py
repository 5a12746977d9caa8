"""The points of a run: what was measured, what will be, and how a campaign's package names its own.

A package registers a `SceneSource` under the entry points `cellctl.scene_sources`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, lru_cache
from importlib.metadata import entry_points
from typing import Any, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.console.scene.setting import Setting
from cellctl.journal import Outcome, RecordedRow, RunState
from cellctl.kinematics import Floats
from cellctl.records import ResidualsRow, Row

GROUP = "cellctl.scene_sources"
"""The entry point group: name = the source's, value = a `SceneSource`."""


ROBOTS = ("nominal robot", "identified robot")
"""What residuals before and after are of, unless a source states another pair."""


class Role(StrEnum):
    """What a point is for."""

    FIT = "fit"
    HELD_OUT = "held-out"
    TARGET = "target"
    CHECK = "check"


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """N points of one name and role, in the order of measurement, or of the plan.

    name: of one of them, as "touch". role: CHECK: no fit uses it and it judges nothing. label (N,): unique among those
    with this name. at (N, 3): robot's base frame, mm. seq (N,): event of the measurement; 0: not measured yet.
    before, after (N,): residual, mm, of the nominal robot, and of the identified or compensated one. sigma (N,):
    predicted 1 σ of `after`, mm. NaN: not known. compared: what the residuals before and after are of.
    """

    name: str
    role: Role
    label: Sequence[str]
    at: Floats
    seq: Floats
    before: Floats
    after: Floats
    sigma: Floats
    compared: tuple[str, str] = ROBOTS

    @classmethod
    def of(
        cls,
        name: str,
        role: Role,
        label: Sequence[object],
        at: ArrayLike,
        *,
        seq: ArrayLike = 0.0,
        before: ArrayLike = np.nan,
        after: ArrayLike = np.nan,
        sigma: ArrayLike = np.nan,
        compared: tuple[str, str] = ROBOTS,
    ) -> Self:
        """N points; seq and numbers in mm may be one for all."""
        n = len(label)
        columns = {"seq": seq, "before": before, "after": after, "sigma": sigma}
        full = {key: np.broadcast_to(np.asarray(value, float), (n,)) for key, value in columns.items()}
        places = np.reshape(at, (n, 3))
        return cls(name=name, role=role, label=[str(one) for one in label], at=places, compared=compared, **full)

    def __len__(self) -> int:
        return len(self.label)

    @property
    def residual(self) -> Floats:
        """The residual (N,), mm: after if it is known, else before; NaN: not known."""
        return np.where(np.isnan(self.after), self.before, self.after)

    def parts(self, of: Mapping[Role, Any]) -> Iterator[Self]:
        """Split by role: `of` has a mask (N,) for each."""
        for role, mask in of.items():
            chosen = np.flatnonzero(mask).tolist()
            if chosen:
                columns = {key: getattr(self, key)[chosen] for key in ("at", "seq", "before", "after", "sigma")}
                yield replace(self, role=role, label=[self.label[index] for index in chosen], **columns)


Lengths: TypeAlias = Mapping[tuple[float, ...], tuple[float, float]]


@final
@dataclass(frozen=True, eq=False)
class SceneRun:
    """What a source reads: the run so far, its robot and its cell. The run may grow meanwhile, in another thread."""

    state: RunState
    setting: Setting

    def rows(self, kind: type[Row]) -> tuple[list[Mapping[str, Any]], Floats]:
        """The rows of this class that count, as the journal holds them, and the number of the event of each (N,).

        They are not checked against the class, which takes seconds for ten thousand of them.
        """
        found = self._rows.get(kind.KIND, [])
        return [row.event.data for row in found], np.array([row.seq for row in found], float)

    @cached_property
    def _rows(self) -> Mapping[str, list[RecordedRow]]:
        """Kind of row → those that count."""
        found: dict[str, list[RecordedRow]] = {}
        for row in self.state.rows:
            if self.state.counts(row):
                found.setdefault(row.event.row_kind, []).append(row)
        return found

    def planned(self, name: str) -> Iterator[Mapping[str, Any]]:
        """The entries of the lists called `name` in the results of finished steps, or of lists in these."""
        for step in list(self.state.steps.values()):
            if step.outcome is Outcome.DONE:
                yield from _lists(step.result, name)

    def residuals(self, readings: Sequence[Sequence[float]]) -> tuple[Floats, Floats]:
        """Residuals of the rows with these readings (N, n), deg: before and after (N,), mm; NaN: not identified yet."""
        found = self._by_readings
        if not found:
            return np.full(len(readings), np.nan), np.full(len(readings), np.nan)
        pairs = [found.get(_rounded(each), (np.nan, np.nan)) for each in readings]
        columns = np.array(pairs, float).reshape(-1, 2)
        return columns[:, 0], columns[:, 1]

    @property
    def _by_readings(self) -> Lengths:
        rows, _ = self.rows(ResidualsRow)
        return _lengths(rows[-1]) if rows else {}


def _lists(data: object, name: str) -> Iterator[Mapping[str, Any]]:
    for key, value in data.items() if isinstance(data, dict) else ():
        if not _of_entries(value):
            continue
        if key == name:
            yield from value
        elif any(_of_entries(inside) for inside in value[0].values()):
            for each in value:
                yield from _lists(each, name)


def _of_entries(value: object) -> bool:
    return isinstance(value, list) and bool(value) and isinstance(value[0], dict)


_latest: deque[tuple[Mapping[str, Any], Lengths]] = deque(maxlen=8)
"""Residuals that were asked for last, by the row that they are from."""


def _lengths(row: Mapping[str, Any]) -> Lengths:
    """Readings → residual before and after, mm."""
    for known, lengths in list(_latest):
        if known is row:
            return lengths
    ends = (np.linalg.norm(np.array(row[name], float).reshape(-1, 3), axis=1).tolist() for name in ("before", "after"))
    lengths = dict(zip(map(_rounded, row["readings"]), zip(*ends, strict=True), strict=True))
    _latest.append((row, lengths))
    return lengths


def _rounded(readings: Sequence[Any]) -> tuple[float, ...]:
    return tuple(round(float(value), 4) for value in readings)


@final
@dataclass(frozen=True, kw_only=True)
class SceneSource:
    """What a campaign's package shows of its own rows.

    points: measured and coming ones. found: places that the run found, mm, of what the cell file places roughly: name
    of a sphere or nest → (3,), robot's base frame; "station" → (4, 4).
    """

    points: Callable[[SceneRun], Sequence[Points]]
    found: Callable[[SceneRun], Mapping[str, Floats]] = field(default=lambda _: {})


@lru_cache(maxsize=1)
def installed_sources() -> tuple[tuple[SceneSource, ...], tuple[str, ...]]:
    """The sources of the installed packages, and those that cannot be loaded, as text."""
    usable, broken = [], []
    for point in sorted(entry_points(group=GROUP), key=lambda each: each.name):
        try:
            source = point.load()
        except Exception as error:  # the code of another package may raise anything
            broken.append(f"scene source '{point.name}' ({point.value}) cannot be loaded: {error}")
            continue
        if isinstance(source, SceneSource):
            usable.append(source)
        else:
            broken.append(f"scene source '{point.name}' ({point.value}) is no SceneSource")
    return tuple(usable), tuple(broken)
