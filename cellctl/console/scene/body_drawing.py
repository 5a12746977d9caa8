"""Spheres, nests, reflectors and the instrument: each drawn once, moved if its place changes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import final

import numpy as np
from nicegui import ui
from nicegui.elements.scene.scene_object3d import Object3D

from cellctl.console.scene.content import Body, Kind
from cellctl.console.scene.shapes import ball, place, rod, y_along
from cellctl.kinematics import Floats

_SPHERE, _PLATE, _STEM, _NEST, _REFLECTOR, _HOUSING, _LEG, _BEAM = (
    "#7fa3bf",
    "#dfe4ea",
    "#9aa4ae",
    "#5b6673",
    "#cc79a7",
    "#39434f",
    "#9aa4ae",
    "#d55e00",
)
_LABEL = (
    "font: 600 12px/1 'Helvetica Neue', Arial, 'Liberation Sans', sans-serif; color: #1f2328; "
    "background: rgb(255 255 255 / .8); border-radius: 3px; padding: 2px 4px; white-space: nowrap"
)
_REFLECTOR_M = 0.019
"""Radius of a reflector's ball of 1.5 inches."""


@final
class BodyDrawing:
    """The bodies in a scene, and the line of sight from the instrument to the first reflector. root: their parent."""

    def __init__(self, scene: ui.scene, root: Object3D) -> None:
        self._scene, self._root = scene, root
        self._groups: dict[tuple[Kind, str], Object3D] = {}
        self._beam: Object3D | None = None

    def show(self, bodies: Sequence[Body], floor_mm: float) -> None:
        """Draw new bodies, and move the others to their places."""
        for body in bodies:
            key = (body.kind, body.name)
            if key not in self._groups:
                self._groups[key] = self._drawn(body, floor_mm)
            pose = np.eye(4)
            pose[:3, 3] = body.at
            place(self._groups[key], pose)
        self._aim(bodies)

    def _drawn(self, body: Body, floor_mm: float) -> Object3D:
        with self._scene, self._root, self._scene.group() as group:
            _DRAWINGS[body.kind](self._scene, body, floor_mm)
        return group

    def _aim(self, bodies: Sequence[Body]) -> None:
        ends = list(_line_of_sight(bodies))
        if len(ends) < 2:
            return
        if self._beam is None:
            with self._scene, self._root:
                self._beam = self._scene.cylinder(0.003, 0.003, 1.0, 8).material(_BEAM, 0.75)
        start, end = ends
        length = float(np.linalg.norm(end - start))
        self._beam.move(*np.round((start + end) / 2.0, 6).tolist())
        self._beam.rotate_R(np.round(y_along((end - start) / length), 8).tolist())
        self._beam.scale(1.0, round(length, 6), 1.0)


def _line_of_sight(bodies: Sequence[Body]) -> Iterator[Floats]:
    """The instrument and the first reflector, m, if both are there."""
    for kind in (Kind.STATION, Kind.REFLECTOR):
        yield from [0.001 * np.array(body.at) for body in bodies if body.kind is kind][:1]


def _sphere(scene: ui.scene, body: Body, _: float) -> None:
    radius = 0.001 * body.radius_mm
    ball(scene, [0, 0, 0], radius, _SPHERE, 0.55)
    if body.plate_mm is not None:
        foot = [0.0, 0.0, 0.001 * (body.plate_mm - body.at[2])]
        rod(scene, [0, 0, -0.9 * radius], foot, 0.001 * body.stem_mm, _STEM)
    _label(scene, body.name, 2.6 * radius)


def _plate(scene: ui.scene, body: Body, _: float) -> None:
    along_x, along_y = (0.001 * size for size in body.size_mm)
    scene.box(along_x, along_y, 0.015).material(_PLATE, 0.9).move(0.0, 0.0, -0.0075)


def _nest(scene: ui.scene, body: Body, floor_mm: float) -> None:
    foot = 0.001 * (floor_mm - body.at[2])
    ball(scene, [0, 0, 0], 1.5 * _REFLECTOR_M, _NEST)
    rod(scene, [0, 0, foot], [0, 0, -_REFLECTOR_M], 0.008, _LEG)
    rod(scene, [0, 0, foot], [0, 0, foot + 0.01], 0.06, _LEG)
    _label(scene, body.name, 0.09)


def _reflector(scene: ui.scene, body: Body, _: float) -> None:
    ball(scene, [0, 0, 0], _REFLECTOR_M, _REFLECTOR)


def _station(scene: ui.scene, body: Body, floor_mm: float) -> None:
    """A theodolite's head on a tripod."""
    foot = 0.001 * (floor_mm - body.at[2])
    rod(scene, [0, 0, -0.16], [0, 0, -0.08], 0.085, _HOUSING)
    for side in (-0.08, 0.08):
        rod(scene, [side, 0, -0.09], [side, 0, 0.06], 0.025, _HOUSING)
    rod(scene, [-0.09, 0, 0], [0.09, 0, 0], 0.05, _LEG)
    for angle in np.radians([90.0, 210.0, 330.0]):
        away = np.array([np.cos(angle), np.sin(angle)])
        rod(scene, [*0.05 * away, -0.16], [*0.4 * away, foot], 0.018, _LEG)
    _label(scene, body.name, 0.16)


def _label(scene: ui.scene, text: str, height: float) -> None:
    scene.text(text, _LABEL).move(0.0, 0.0, height)


_DRAWINGS: dict[Kind, Callable[[ui.scene, Body, float], None]] = {
    Kind.SPHERE: _sphere,
    Kind.NEST: _nest,
    Kind.REFLECTOR: _reflector,
    Kind.STATION: _station,
    Kind.PLATE: _plate,
}
