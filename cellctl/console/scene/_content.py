"""The content of the 3-D scene: robot and posture, spheres, instrument, nests, points, from a journal. No drawing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, final

import numpy as np

from cellctl.console.scene.run_points import Points, SceneRun, SceneSource, Setting, installed_sources
from cellctl.files import InputError
from cellctl.formats.artefact import Artefact
from cellctl.journal import RunState
from cellctl.kinematics import Floats, pose_from_xyz_abc

_FIELDS = ("resting", "at_contact", "joints", "commanded")
"""Fields of rows that hold readings, the latest in time first."""


@final
@dataclass(frozen=True, eq=False)
class Posture:
    """The nominal robot. readings (n,), deg; source: where they are from, in words.

    frames (n + 2, 4, 4), robot's base frame, mm: behind joints 1 … n, each with its z along the joint's axis, then
    flange and TCP.
    """

    readings: tuple[float, ...]
    source: str
    frames: Floats


def posture_of(state: RunState, setting: Setting) -> Posture | None:
    """The robot at the last readings in the journal, else at home of the cell file, else at zero; None: no robot."""
    if setting.chain is None or setting.joints is None:
        return None
    readings, source = _last(state, setting.chain.n) or _assumed(setting)
    frames = setting.chain.frames(setting.joints.model(np.array(readings)))
    tcp = frames[-1] @ setting.chain.tool
    return Posture(readings, source, np.concatenate([frames, tcp[None]]))


def _last(state: RunState, n: int) -> tuple[tuple[float, ...], str] | None:
    for row in reversed(state.rows):
        readings = _readings(row.event.data, n)
        if readings is not None:
            number = row.event.data.get("number")
            return (
                readings,
                f"recorded with {row.event.row_kind.replace('_', ' ')}{'' if number is None else f' {number}'}",
            )
    return None


def _readings(data: Mapping[str, Any], n: int) -> tuple[float, ...] | None:
    for name in _FIELDS:
        value = data.get(name)
        if isinstance(value, list | tuple) and len(value) == n and all(isinstance(one, int | float) for one in value):
            return tuple(float(one) for one in value)
    return None


def _assumed(setting: Setting) -> tuple[tuple[float, ...], str]:
    assert setting.chain is not None
    if len(setting.home) == setting.chain.n:
        return setting.home, "home of the cell file: nothing is recorded yet"
    return (0.0,) * setting.chain.n, "all joints at zero: nothing is recorded yet"


Vector = tuple[float, ...]


_EDGE_MM = 80.0
"""The plate is drawn this much wider than its spheres: the cell file states only its height."""


class Kind(StrEnum):
    """What a body is."""

    SPHERE = "sphere"
    NEST = "nest"
    STATION = "instrument"
    REFLECTOR = "reflector"
    PLATE = "plate"


@final
@dataclass(frozen=True)
class Body:
    """A thing in the cell. at: its centre, robot's base frame, mm. found: the run found its place; else it is the cell
    file's rough one. radius_mm: of a sphere; stem_mm: of its stem, down to plate_mm (None: not stated). size_mm: of a
    plate along x and y.
    """

    kind: Kind
    name: str
    at: Vector
    found: bool = False
    radius_mm: float = 0.0
    stem_mm: float = 0.0
    plate_mm: float | None = None
    size_mm: Vector = ()


@final
@dataclass(frozen=True, eq=False)
class SceneContent:
    """All lengths in mm, in the robot's base frame. robot: name of its file.

    points: in groups; those with `seq` 0 are still to come. floor_mm: height of the floor. problems: what is not shown,
    and why.
    """

    robot: str = ""
    posture: Posture | None = None
    bodies: tuple[Body, ...] = ()
    points: tuple[Points, ...] = ()
    floor_mm: float = 0.0
    problems: tuple[str, ...] = ()

    @property
    def greatest_mm(self) -> float | None:
        """The greatest residual that is shown, mm; None without residuals."""
        values = np.concatenate([group.residual for group in self.points]) if self.points else np.zeros(0)
        known = values[np.isfinite(values)]
        return float(known.max()) if known.size else None


def scene_of(state: RunState) -> SceneContent:
    """The scene of a run so far. What cannot be read is among `problems`; nothing is raised for it."""
    setting = Setting.of(state.started)
    sources, broken = installed_sources()
    problems = [*setting.problems, *broken]
    run = SceneRun(state, setting)
    points = read_points(run, sources, problems)
    found = _found(run, sources, problems)
    posture = posture_of(state, setting)
    bodies = tuple(_bodies(setting, found, posture))
    floor = _floor(setting, bodies, points, posture)
    return SceneContent(setting.robot, posture, bodies, points, floor, tuple(problems))


def read_points(run: SceneRun, sources: Iterable[SceneSource], problems: list[str]) -> tuple[Points, ...]:
    """The points of all sources; what they refuse is added to `problems`."""
    groups: list[Points] = []
    for source in sources if run.setting.chain else ():
        with _named(problems):
            groups += source.points(run)
    return tuple(group for group in groups if len(group))


@contextmanager
def _named(problems: list[str]) -> Iterator[None]:
    """Add what a source raises to `problems`, once."""
    try:
        yield
    except Exception as error:  # the code of another package may raise anything
        text = _text(error)
        if text not in problems:
            problems.append(text)


def _text(error: Exception) -> str:
    if isinstance(error, KeyError):
        cure = "read it with the cellctl that wrote it, or restore the run folder from a copy"
        return f"journal: a row is without {error}\n    {cure}"
    return str(error) if isinstance(error, InputError) else f"a scene source failed: {error!r}"


def _found(run: SceneRun, sources: Iterable[SceneSource], problems: list[str]) -> Mapping[str, Floats]:
    places: dict[str, Floats] = {}
    for source in sources if run.setting.chain else ():
        with _named(problems):
            places |= source.found(run)
    return places


def _bodies(setting: Setting, found: Mapping[str, Floats], posture: Posture | None) -> Iterable[Body]:
    if setting.artefact:
        yield from _spheres(setting.artefact, found)
    if setting.station:
        rough = pose_from_xyz_abc(setting.station.xyz, setting.station.abc)
        at = np.asarray(found.get("station", rough))[:3, 3]
        yield Body(Kind.STATION, "instrument", _vector(at), "station" in found)
    for nest in setting.nests:
        yield Body(Kind.NEST, nest.id, _vector(found.get(nest.id, nest.xyz)), nest.id in found)
    if not posture:
        return
    for one in setting.reflectors:
        at = setting.reflector(one.id, [posture.readings])[0]
        yield Body(Kind.REFLECTOR, one.id, _vector(at))


def _spheres(artefact: Artefact, found: Mapping[str, Floats]) -> Iterable[Body]:
    plate = artefact.plate
    if plate:
        corners = np.array([sphere.centre[:2] for sphere in artefact.spheres])
        low, high = corners.min(axis=0) - _EDGE_MM, corners.max(axis=0) + _EDGE_MM
        middle = (*((low + high) / 2.0), plate.z)
        yield Body(Kind.PLATE, "plate", _vector(middle), size_mm=_vector(high - low))
    for sphere in artefact.spheres:
        yield Body(
            Kind.SPHERE,
            sphere.id,
            _vector(found.get(sphere.id, sphere.centre)),
            sphere.id in found,
            sphere.diameter / 2.0,
            plate.stem_radius if plate else 0.0,
            plate.z if plate else None,
        )


def _vector(values: object) -> Vector:
    return tuple(np.asarray(values, float).tolist())


def _floor(setting: Setting, bodies: Iterable[Body], points: Iterable[Points], posture: Posture | None) -> float:
    """The cell file's floor; else the base's, or lower if anything is."""
    if setting.floor_mm is not None:
        return setting.floor_mm
    heights = [body.at[2] - body.radius_mm for body in bodies]
    heights += [float(group.at[:, 2].min()) for group in points]
    heights += [float(posture.frames[:, 2, 3].min())] if posture else []
    return min(0.0, *heights) if heights else 0.0
