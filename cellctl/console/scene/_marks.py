"""The points of the scene as marks: a shape for each role, a colour for each residual; their legend."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from nicegui import ui
from nicegui.elements.scene.scene_object3d import Object3D

from cellctl.console.scene.run_points import Points, Role
from cellctl.kinematics import Floats

LEAST_MM, MOST_MM = 0.01, 10.0
"""Ends of the scale, the same in every run: colours can be compared, and do not change while a run goes on."""

TICKS_MM = (0.01, 0.1, 1.0, 10.0)

_VIRIDIS = ("#addc30", "#5ec962", "#28ae80", "#21918c", "#2c728e", "#3b528b", "#472d7b", "#440154")
"""matplotlib's viridis at 0.875, 0.75, …, 0: without its end in light yellow, which a light ground hides."""

UNKNOWN = "#8d96a0"
"""A point without a known residual."""

COMING = "#6b7580"
"""The outline of a point that is still to be measured."""

RGB = tuple[float, float, float]


def rgb(colour: str) -> RGB:
    """Red, green, blue from 0 to 1 of `#rrggbb` (sRGB)."""
    red, green, blue = (int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    return red, green, blue


_TABLE = np.array([rgb(colour) for colour in _VIRIDIS])


def residual_colours(residual: Floats) -> Floats:
    """Colours (N, 3), sRGB from 0 to 1, of residuals (N,), mm; NaN has the colour UNKNOWN."""
    known = np.isfinite(residual)
    size = np.clip(np.where(known, np.abs(residual), LEAST_MM), LEAST_MM, MOST_MM)
    share = np.log10(size / LEAST_MM) / np.log10(MOST_MM / LEAST_MM)
    at = np.linspace(0.0, 1.0, len(_TABLE))
    colours = np.stack([np.interp(share, at, channel) for channel in _TABLE.T], axis=-1)
    return np.where(known[:, None], colours, rgb(UNKNOWN))


def gradient() -> str:
    """The scale as a CSS gradient, least to most."""
    return f"linear-gradient(to right, {', '.join(_VIRIDIS)})"


Value = tuple[float, ...]


@final
@dataclass(frozen=True)
class Change:
    """The array has `length` places from now on; those at `places` have new `values`, one after the other."""

    length: int
    places: Sequence[int]
    values: Sequence[float]


@final
class Slots:
    """Gives each point a place and keeps it there; a removed one is replaced by the last."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._values: list[Value] = []
        self._place: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._names)

    @property
    def values(self) -> list[float]:
        """All values, one after the other."""
        return [number for value in self._values for number in value]

    def update(self, wanted: Mapping[str, Value]) -> Change | None:
        """Hold exactly the points `wanted`; None if that changes nothing."""
        before = len(self)
        changed = {place for name in [n for n in self._names if n not in wanted] for place in self._removed(name)}
        for name, value in wanted.items():
            place = self._place.get(name)
            if place is None:
                changed.add(self._added(name, value))
            elif self._values[place] != value:
                self._values[place] = value
                changed.add(place)
        places = sorted(place for place in changed if place < len(self))
        if not places and len(self) == before:
            return None
        return Change(len(self), places, [number for place in places for number in self._values[place]])

    def _added(self, name: str, value: Value) -> int:
        self._place[name] = len(self._names)
        self._names.append(name)
        self._values.append(value)
        return self._place[name]

    def _removed(self, name: str) -> list[int]:
        place, last, value = self._place.pop(name), self._names.pop(), self._values.pop()
        if last == name:
            return []
        self._names[place], self._values[place], self._place[last] = last, value, place
        return [place]


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


WORDS: Mapping[Role, str] = {
    Role.FIT: "of the fit",
    Role.HELD_OUT: "held-out",
    Role.TARGET: "target of the proof",
    Role.CHECK: "check or search",
}

_PATHS = {
    "disc": '<circle cx="8" cy="8" r="5.5"/>',
    "diamond": '<path d="M8 1.5 14.5 8 8 14.5 1.5 8z"/>',
    "triangle": '<path d="M8 1.5 14.5 13.5H1.5z"/>',
    "square": '<path d="M4 4h8v8H4z"/>',
}


@final
class Legend:
    """Names each kind of point that the scene holds, with how many there are."""

    def __init__(self) -> None:
        self._counts: dict[tuple[Role, bool], tuple[ui.element, ui.label]] = {}
        with ui.element("div").classes("scene-legend").props('role=group aria-label="Legend of the scene"'):
            for hollow in (False, True):
                for role in Role:
                    self._counts[role, hollow] = _entry(role, hollow)
        _scale()

    def show(self, groups: Sequence[Points]) -> None:
        """Show the counts of these groups; a kind without points is left out."""
        for (role, hollow), (entry, label) in self._counts.items():
            mine = (group for group in groups if group.role is role)
            count = sum(int(((group.seq == 0) == hollow).sum()) for group in mine)
            if label.text != str(count):
                label.set_text(str(count))
            if entry.visible != bool(count):
                entry.set_visibility(bool(count))


def _entry(role: Role, hollow: bool) -> tuple[ui.element, ui.label]:
    entry = ui.element("span").classes("entry")
    with entry:
        if hollow:
            _drawn(SHAPES[role], "none", COMING, 2.2)
        else:
            _drawn(SHAPES[role], UNKNOWN if role is Role.CHECK else "#28ae80", "#1f2328", 1.2)
        ui.label(f"{SHAPES[role]}{', hollow' if hollow else ''}: {WORDS[role]}, {'to come' if hollow else 'measured'}")
        count = ui.label("0").classes("count")
    entry.set_visibility(False)
    return entry, count


def _drawn(shape: str, fill: str, stroke: str, width: float) -> None:
    look = f'fill="{fill}" stroke="{stroke}" stroke-width="{width}"'
    ui.html(f'<svg width="16" height="16" {look} aria-hidden="true">{_PATHS[shape]}</svg>', sanitize=False)


def _scale() -> None:
    with ui.element("div").classes("scene-legend"):
        with ui.element("div").classes("scene-scale"):
            ui.label("residual, mm")
            ui.element("div").classes("bar").style(f"background: {gradient()}")
            with ui.element("div").classes("ticks"):
                for value in TICKS_MM:
                    ui.label(f"{value:g}")
        with ui.element("span").classes("entry"):
            _drawn("disc", UNKNOWN, "#1f2328", 1.2)
            ui.label("grey: residual not known")
