"""The robot as links and joints: bodies that are fixed to its joint frames, which move."""

from __future__ import annotations

from typing import final

import numpy as np
from nicegui import ui

from cellctl.console.scene.posture import Posture
from cellctl.console.scene.shapes import ball, place, rod
from cellctl.kinematics import Floats, inverse_pose

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
