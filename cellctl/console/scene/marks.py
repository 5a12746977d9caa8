"""The points of the scene as marks: a shape for each role, filled if measured, hollow if still to come."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import final

import numpy as np
from nicegui.elements.scene.scene_object3d import Object3D

from cellctl.console.scene.colours import COMING, residual_colours, rgb
from cellctl.console.scene.points import Points, Role
from cellctl.console.scene.slots import Slots, Value

SHAPES = {Role.FIT: "disc", Role.HELD_OUT: "diamond", Role.TARGET: "triangle", Role.CHECK: "square"}

_SIZES = {Role.FIT: 11.0, Role.HELD_OUT: 13.0, Role.TARGET: 13.0, Role.CHECK: 8.0}
"""Width on the screen at 2.4 m, pixels."""

_M = 0.001


@final
class Marks(Object3D, component="marks.js"):
    """Marks of one shape. shape: of `SHAPES`; hollow: an outline only; size: on the screen at 2.4 m, pixels."""

    def __init__(self, shape: str, size: float, *, hollow: bool) -> None:
        self._slots = Slots()
        super().__init__(shape, hollow, size, 0, [])

    def show(self, wanted: dict[str, Value]) -> None:
        """Show exactly these marks: name → x, y, z, m, and red, green, blue. Only what changed is sent."""
        change = self._slots.update(wanted)
        if change is None:
            return
        self.args[3:] = [len(self._slots), self._slots.values]
        self.run_method("set_marks", change.length, change.places, change.values)


@final
class PointMarks:
    """All points of a scene; create it inside a scene."""

    def __init__(self) -> None:
        self._marks = {
            (role, hollow): Marks(SHAPES[role], _SIZES[role] - 2.0 * hollow, hollow=hollow)
            for role in Role
            for hollow in (True, False)
        }

    def show(self, groups: Sequence[Points]) -> None:
        """Show the points of these groups."""
        wanted: dict[tuple[Role, bool], dict[str, Value]] = {key: {} for key in self._marks}
        for group in groups:
            for hollow, name, value in _values(group):
                wanted[group.role, hollow][name] = value
        for key, marks in self._marks.items():
            marks.show(wanted[key])


def _values(group: Points) -> Iterator[tuple[bool, str, Value]]:
    """Of each point: whether it is to come, its name, place in m, and colour."""
    coming = group.seq == 0
    colours = np.where(coming[:, None], rgb(COMING), residual_colours(group.residual))
    numbers = np.concatenate([np.round(group.at * _M, 5), np.round(colours, 3)], axis=1).tolist()
    for hollow, label, value in zip(coming.tolist(), group.label, numbers, strict=True):
        yield hollow, f"{group.name} {label}", tuple(value)
