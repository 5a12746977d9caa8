"""The points of a run, measured and to come, as each campaign's package names them; robot and cell of the run.

A package registers a `SceneSource` under the entry points `cellctl.scene_sources`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property, lru_cache
from typing import Any, Self, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike

from cellctl.files import Document, InputError, parse_yaml
from cellctl.formats import Artefact, RobotFile, artefact_of
from cellctl.formats.cell_sections import FlangeReflector, Nest, Station, floor_of, reflectors_of, station_of
from cellctl.installed import contributions
from cellctl.journal import Outcome, RecordedRow, RunState
from cellctl.journal.events import RunStarted, SourceFile
from cellctl.kinematics import Floats, JointMap, SerialChain
from cellctl.records import ResidualsRow, Row


@final
@dataclass(frozen=True, eq=False)
class Setting:
    """Robot and cell files of a run. chain: the nominal robot, its base as origin.

    artefact, station: None if the cell file has none. floor_mm: height of the floor in the base frame; None if not
    stated. home (n,): readings, deg; empty if not stated. problems: what could not be read, as text.
    """

    chain: SerialChain | None = None
    joints: JointMap | None = None
    robot: str = ""
    artefact: Artefact | None = None
    station: Station | None = None
    reflectors: tuple[FlangeReflector, ...] = ()
    floor_mm: float | None = None
    home: tuple[float, ...] = ()
    problems: tuple[str, ...] = ()

    @classmethod
    def of(cls, started: RunStarted | None) -> Setting:
        """The setting of a run; empty before its start. Its texts are read once."""
        if started is None:
            return cls(problems=("The run has not begun.",))
        return _read(_key(started.robot), _key(started.cell))

    @property
    def nests(self) -> Sequence[Nest]:
        """The monument nests of the cell file."""
        return self.station.nests if self.station else ()

    def flange(self, readings: ArrayLike) -> Floats:
        """Poses of the nominal flange (N, 4, 4) at readings (N, n), deg, in the robot's base frame, mm."""
        assert self.chain
        assert self.joints
        return self.chain.forward_flange(self.joints.model(np.asarray(readings, float)))

    def tcp(self, readings: ArrayLike) -> Floats:
        """Places of the nominal TCP (N, 3) at readings (N, n), deg, in the robot's base frame, mm."""
        assert self.chain
        return self._on_flange(readings, self.chain.tool[:3, 3])

    def reflector(self, name: str, readings: ArrayLike) -> Floats:
        """Places (N, 3) of the reflector called `name`, by the nominal robot, in its base frame, mm.

        The flange's own place if the cell file has no such reflector.
        """
        offset = next((one.xyz for one in self.reflectors if one.id == name), [0.0, 0.0, 0.0])
        return self._on_flange(readings, np.array(offset))

    def _on_flange(self, readings: ArrayLike, offset: Floats) -> Floats:
        flange = self.flange(readings)
        return np.asarray(flange[:, :3, 3] + flange[:, :3, :3] @ offset)


def _key(source: SourceFile | None) -> tuple[str, str] | None:
    return (source.path, source.text) if source else None


@lru_cache(maxsize=32)
def _read(robot: tuple[str, str] | None, cell: tuple[str, str] | None) -> Setting:
    problems: list[str] = []
    parts: dict[str, object] = {}
    for source, reader in ((robot, _robot), (cell, _cell)):
        try:
            parts |= reader(parse_yaml(source[1], source[0])) if source else {}
        except InputError as error:
            problems.append(str(error))
    if "chain" not in parts and not problems:
        problems.append("The journal holds no robot file: the robot is not shown.")
    return Setting(**parts, problems=tuple(problems))  # type: ignore[arg-type]


def _robot(document: Document) -> dict[str, object]:
    robot = RobotFile.from_document(document)
    return {"chain": robot.chain().with_base(np.eye(4)), "joints": robot.joint_map(), "robot": robot.name}


def _cell(document: Document) -> dict[str, object]:
    has = document.data if isinstance(document.data, dict) else {}
    postures = has.get("postures")
    home = postures.get("home", ()) if isinstance(postures, dict) else ()
    floor = floor_of(document)
    return {
        "artefact": artefact_of(document, ("artefact",)) if "artefact" in has else None,
        "station": station_of(document) if "station" in has else None,
        "reflectors": tuple(reflectors_of(document).on_flange) if "reflectors" in has else (),
        "floor_mm": float(floor.z) if floor else None,
        "home": tuple(float(value) for value in home),
    }


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
    broken: list[str] = []
    usable = tuple(source for _, source in contributions(GROUP, SceneSource, "scene source", broken))
    return usable, tuple(broken)
