"""The content of the scene as a table, for screens without WebGL and for screen readers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

from nicegui import ui

from cellctl.console.look import command_button
from cellctl.console.scene.content import Body, SceneContent
from cellctl.console.scene.points import Points, Role

PAGE = 25
"""Points on a page of the table."""

HEADINGS = ("what", "use", "state", "X, mm", "Y, mm", "Z, mm", "residual, mm", "σ, mm")

_WORDS = 3
"""The first columns are words, the others numbers."""

Row = tuple[str, ...]


def body_rows(content: SceneContent) -> list[Row]:
    """Robot, spheres, nests, instrument and reflectors, as texts under `HEADINGS`."""
    rows: list[Row] = []
    if content.posture:
        rows.append(
            (
                "TCP of the robot",
                "",
                content.posture.source,
                *_place(content.posture.frames[-1, :3, 3].tolist()),
                "",
                "",
            )
        )
    return [*rows, *(_body_row(body) for body in content.bodies)]


def point_rows(groups: Sequence[Points], first: int, count: int) -> list[Row]:
    """The points number `first` (from 0) and up to `count` in all, as texts under `HEADINGS`."""
    rows: list[Row] = []
    for group in groups:
        rows += [_point_row(group, index) for index in range(max(0, first), min(len(group), first + count - len(rows)))]
        first = max(0, first - len(group))
    return rows


def _body_row(body: Body) -> Row:
    if body.radius_mm:
        name = f"sphere {body.name}, radius {body.radius_mm:.2f} mm"
    else:
        name = body.name if body.name == body.kind else f"{body.kind} {body.name}"
    return name, "", "found" if body.found else "by the files", *_place(body.at), "", ""


def _point_row(group: Points, index: int) -> Row:
    state = "measured" if group.seq[index] else "to come"
    use = "" if group.role is Role.CHECK else str(group.role)
    numbers = (_number(group.residual[index]), _number(group.sigma[index]))
    return f"{group.name} {group.label[index]}", use, state, *_place(group.at[index]), *numbers


def _place(at: Sequence[float]) -> tuple[str, str, str]:
    x, y, z = (f"{float(value):.1f}" for value in at)
    return x, y, z


def _number(value: float) -> str:
    return f"{value:.3f}" if math.isfinite(value) else "not known"


@final
class ContentTable:
    """The table, folded at first: its rows are sent while it is open, one page at a time."""

    def __init__(self) -> None:
        self._content, self._first, self._shown = SceneContent(), 0, None
        with ui.element("details").classes("scene-table") as self._details:
            with ui.element("summary"):
                ui.label("The scene as a table").style("display: inline")
            self._parts = [_Part("Bodies, in the robot's base frame"), _Part("Points, in the robot's base frame")]
            with ui.element("div").classes("row"):
                command_button("Previous", lambda: self._turn(-PAGE))
                command_button("Next", lambda: self._turn(PAGE))
                self._where = ui.label().classes("note").props("role=status")
        self._open = False
        self._details.on("toggle", self._toggled, js_handler="(event) => emit(event.target.open)")

    def show(self, content: SceneContent) -> None:
        """Keep the table on this content."""
        self._content = content
        if self._open:
            self._fill()

    def _toggled(self, event: object) -> None:
        self._open = bool(getattr(event, "args", False))
        self.show(self._content)

    def _turn(self, by: int) -> None:
        count = sum(map(len, self._content.points))
        self._first = min(max(0, self._first + by), max(0, (count - 1) // PAGE * PAGE))
        self._fill()

    def _fill(self) -> None:
        count = sum(map(len, self._content.points))
        self._parts[0].show(body_rows(self._content))
        self._parts[1].show(point_rows(self._content.points, self._first, PAGE))
        last = min(self._first + PAGE, count)
        self._where.set_text(f"points {self._first + 1} to {last} of {count}" if count else "no points yet")


@final
class _Part:
    """One plain table; unchanged rows send nothing."""

    def __init__(self, caption: str) -> None:
        self._rows: list[Row] = []
        with ui.element("div").classes("scrolling").props("tabindex=0"), ui.element("table").classes("figures"):
            with ui.element("caption"):
                ui.label(caption)
            with ui.element("thead"), ui.element("tr"):
                for index, heading in enumerate(HEADINGS):
                    _cell("th", heading, index, "scope=col")
            self._body = ui.element("tbody")

    def show(self, rows: list[Row]) -> None:
        if rows == self._rows:
            return
        self._rows = rows
        self._body.clear()
        with self._body:
            for row in rows:
                with ui.element("tr"):
                    for index, text in enumerate(row):
                        _cell("td", text, index)


def _cell(tag: str, text: str, column: int, props: str = "") -> None:
    with ui.element(tag).classes("words" if column < _WORDS else "").props(props):
        ui.label(text)
