"""The content of the 3-D scene: robot, spheres, instrument, nests and points, from a run's journal. No drawing."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from typing import final

import numpy as np

from cellctl.console.scene.points import Points, SceneRun, SceneSource, installed_sources
from cellctl.console.scene.posture import Posture, posture_of
from cellctl.console.scene.setting import Setting
from cellctl.files import InputError
from cellctl.formats.artefact import Artefact
from cellctl.journal import RunState
from cellctl.kinematics import Floats, pose_from_xyz_abc

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
