"""Solid shapes along an axis; lengths in metres, as everything that is drawn."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from nicegui import ui
from nicegui.elements.scene.scene_object3d import Object3D
from numpy.typing import ArrayLike

from cellctl.kinematics import Floats

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
