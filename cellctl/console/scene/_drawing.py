"""Bodies of the scene: the robot as links and joints; spheres, nests, reflectors and the instrument."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias, final

import numpy as np
from nicegui import ui
from nicegui.elements.scene.scene_object3d import Object3D
from numpy.typing import ArrayLike

from cellctl.console.scene._content import Body, Kind, Posture
from cellctl.kinematics import Floats, inverse_pose

Matrix: TypeAlias = list[list[float]]

_SEGMENTS = 28


def rod(scene: ui.scene, start: ArrayLike, end: ArrayLike, radius: float, colour: str, *, at_end: float = -1.0) -> None:
    """A cylinder from `start` to `end` (3,), m, of `radius`; `at_end`: its radius there, if it is another."""
    first, last = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(last - first))
    if length < 1e-6:
        return
    top = radius if at_end < 0.0 else at_end
    body = scene.cylinder(top, radius, length, _SEGMENTS).material(colour)
    body.move(*((first + last) / 2.0).tolist()).rotate_R(y_along((last - first) / length))


def ball(scene: ui.scene, at: ArrayLike, radius: float, colour: str, opacity: float = 1.0) -> Object3D:
    """A ball at `at` (3,), m."""
    body: Object3D = scene.sphere(radius, _SEGMENTS, _SEGMENTS // 2).material(colour, opacity)
    return body.move(*np.asarray(at, float).tolist())


def y_along(direction: Floats) -> Matrix:
    """A rotation that carries y, the axis of three.js's cylinders, to the unit vector `direction` (3,)."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(direction, other)
    x /= np.linalg.norm(x)
    rotation: Matrix = np.stack([x, direction, np.cross(x, direction)], axis=1).tolist()
    return rotation


def place(thing: Object3D, pose: Floats) -> None:
    """Move a group to `pose` (4, 4), mm; an unchanged one sends nothing."""
    thing.move(*np.round(pose[:3, 3] * 0.001, 6).tolist())
    thing.rotate_R(np.round(pose[:3, :3], 8).tolist())


_LINK, _JOINT, _CAP, _FOOT, _TOOL, _TIP = "#c6cdd6", "#39434f", "#e69f00", "#8b949e", "#8b949e", "#d55e00"
_THICKNESS = 0.052
"""Radius of the first link's body as a share of the robot's size; the last has half of it."""


@final
class RobotDrawing:
    """A robot in a scene, on a column if the floor is lower; create it inside the scene.

    Its bodies are made once: a new posture moves its frames.
    """

    def __init__(self, scene: ui.scene, posture: Posture, floor_mm: float) -> None:
        frames = np.concatenate([np.eye(4)[None], posture.frames])
        size = 0.001 * float(np.linalg.norm(np.diff(frames[:, :3, 3], axis=0), axis=1).sum())
        self._groups = []
        last = len(frames) - 2  # the flange, which carries the tool
        for index, frame in enumerate(frames[:-1]):
            radius = size * _THICKNESS * (1.0 - 0.5 * index / last)
            to_next = 0.001 * (inverse_pose(frame) @ frames[index + 1])[:3, 3]
            with scene.group() as group:
                if index == 0:
                    rod(scene, [0, 0, 0], [0, 0, 0.25 * radius], 1.7 * radius, _FOOT)
                    rod(scene, [0, 0, 0.001 * floor_mm], [0, 0, 0], 1.3 * radius, _LINK)
                if index < last:
                    _link(scene, to_next, 0.8 * radius)
                if 0 < index < last:
                    _joint(scene, radius)
                if index == last:
                    _tool(scene, to_next, radius)
            self._groups.append(group)
        self.show(posture)

    def show(self, posture: Posture) -> None:
        """Move the robot to a posture."""
        for group, frame in zip(self._groups[1:], posture.frames[:-1], strict=True):
            place(group, frame)


def _link(scene: ui.scene, end: Floats, radius: float) -> None:
    """From a joint to the next: along its axis first, then across, as links are built."""
    corner = np.array([0.0, 0.0, end[2]])
    if np.linalg.norm(end[:2]) > 1e-6 and abs(end[2]) > 1e-6:
        ball(scene, corner, radius, _LINK)
    rod(scene, [0, 0, 0], corner, radius, _LINK)
    rod(scene, corner, end, radius, _LINK)


def _joint(scene: ui.scene, radius: float) -> None:
    """A drum about the joint's axis, with a coloured ring at both ends."""
    rod(scene, [0, 0, -1.15 * radius], [0, 0, 1.15 * radius], 1.12 * radius, _JOINT)
    for side in (-1.15, 1.15):
        rod(scene, [0, 0, side * radius], [0, 0, 1.12 * side * radius], 0.7 * radius, _CAP)


def _tool(scene: ui.scene, tcp: Floats, radius: float) -> None:
    """A disc at the flange, and a rod to the TCP with a point."""
    rod(scene, [0, 0, -0.3 * radius], [0, 0, 0.1 * radius], 1.1 * radius, _JOINT)
    neck = 0.85 * tcp
    rod(scene, [0, 0, 0], neck, 0.3 * radius, _TOOL)
    rod(scene, neck, tcp, 0.3 * radius, _TIP, at_end=0.06 * radius)


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
