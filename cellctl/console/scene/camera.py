"""Where the camera stands, so that it shows all of the content."""

from __future__ import annotations

import math

import numpy as np
from nicegui import ui

from cellctl.console.scene.content import Body, Kind, SceneContent
from cellctl.kinematics import Floats

FIELD_OF_VIEW_DEG = 32.0
"""Vertical: narrow, so that sizes at the back and at the front can be compared."""

_ASPECT = 1.6
"""Width of the picture over its height, at least."""

_THICKNESS = 0.08
"""Of bodies around their places, as a share of the content's size."""

VIEWS = {"All": (0.75, -0.6, 0.42), "Front": (1.0, 0.0, 0.06), "Side": (0.0, -1.0, 0.06), "Top": (0.001, -0.02, 1.0)}
"""Direction from the content to the camera, in the robot's base frame."""


def look_at_all(scene: ui.scene, content: SceneContent, view: str, duration_s: float) -> None:
    """Move the camera so that it shows the content from a side of `VIEWS`."""
    corners = _corners(content)
    thickness = _THICKNESS * float(np.ptp(corners, axis=0).max())
    stand(scene, corners, np.array(VIEWS[view]), duration_s, thickness)


def stand(scene: ui.scene, corners: Floats, direction: Floats, duration_s: float, margin: float) -> None:
    """Move the camera so that `corners` (N, 3), m, are in the picture, with a margin, m, seen from `direction` (3,)."""
    back = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    across, upward, depth = (corners @ axis for axis in (right, np.cross(back, right), back))
    middle = [(each.min() + each.max()) / 2.0 for each in (across, upward, depth)]
    centre = middle[0] * right + middle[1] * np.cross(back, right) + middle[2] * back
    half = math.tan(math.radians(FIELD_OF_VIEW_DEG / 2.0))
    needed = (np.maximum(np.abs(upward - middle[1]), np.abs(across - middle[0]) / _ASPECT) + margin) / half
    distance = float((needed + depth - middle[2]).max())
    (x, y, z), (at_x, at_y, at_z) = (centre + distance * back).tolist(), centre.tolist()
    scene.move_camera(x, y, z, at_x, at_y, at_z, duration=duration_s)


def _around(body: Body, floor_mm: float) -> Floats:
    """Corners of a body, mm: of a plate its own, of the others what stands below and above them."""
    if body.kind is Kind.PLATE:
        x, y = (size / 2.0 for size in body.size_mm)
        corners = np.array([[x, y, 0.0], [x, -y, 0.0], [-x, y, 0.0], [-x, -y, 0.0]])
        return corners + body.at
    foot = body.at[2] if body.kind is Kind.REFLECTOR else floor_mm
    return np.array([body.at, (*body.at[:2], foot), (*body.at[:2], body.at[2] + 3.0 * body.radius_mm)])


def look_at_sphere(scene: ui.scene, content: SceneContent, name: str, duration_s: float) -> None:
    """Move the camera close to the sphere called `name`."""
    for body in content.bodies:
        if body.kind is Kind.SPHERE and body.name == name:
            centre = 0.001 * (np.array(body.at) - [0.0, 0.0, content.floor_mm])
            reach = 0.001 * body.radius_mm * np.array([np.eye(3), -np.eye(3)]).reshape(-1, 3)
            stand(scene, centre + 1.4 * reach, np.array(VIEWS["All"]), duration_s, 0.0)


def _corners(content: SceneContent) -> Floats:
    """Places (N, 3) of the content, m, above the floor; nests may lie outside."""
    corners = [np.array([[0.0, 0.0, content.floor_mm]])]
    corners += [content.posture.frames[:, :3, 3]] if content.posture else []
    corners += [_around(body, content.floor_mm) for body in content.bodies if body.kind is not Kind.NEST]
    corners += [group.at for group in content.points]
    return np.asarray(0.001 * (np.concatenate(corners) - [0.0, 0.0, content.floor_mm]))
