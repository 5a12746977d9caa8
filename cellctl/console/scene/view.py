"""The 3-D scene of a run on a page: robot, bodies and points, with views, legend and a table of the same content."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import final

import numpy as np
from nicegui import ui

from cellctl.console.appearance import command_button, head_style
from cellctl.console.scene._content import Body, Kind, Posture, SceneContent
from cellctl.console.scene._drawing import BodyDrawing, RobotDrawing
from cellctl.console.scene._marks import Legend, PointMarks
from cellctl.console.scene.run_points import Points, Role
from cellctl.kinematics import Floats

FIELD_OF_VIEW_DEG = 32.0
"""Vertical: narrow, so that sizes at the back and at the front can be compared."""

_ASPECT = 1.6
"""Width of the picture over its height, at least."""

_THICKNESS = 0.08
"""Of bodies around their places, as a share of the content's size."""

VIEWS = {"All": (0.75, -0.6, 0.42), "Front": (1.0, 0.0, 0.06), "Side": (0.0, -1.0, 0.06), "Top": (0.001, -0.02, 1.0)}
"""Direction from the content to the camera, in the robot's base frame."""

PAGE = 25
"""Points on a page of the table."""

HEADINGS = ("what", "use", "state", "X, mm", "Y, mm", "Z, mm", "residual, mm", "σ, mm")

_WORDS = 3
"""The first columns are words, the others numbers."""

Row = tuple[str, ...]

CSS = (Path(__file__).parent / "scene.css").read_text(encoding="utf-8")

_NO_WEBGL = "This browser draws no 3-D pictures (WebGL is off). The table below has the same content."
"""Behind the picture, which hides it."""

_GROUND = "#f4f6f8"
_GRID = (12, 24)
"""Size of the grid on the floor, m, and its squares along one side."""


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


@final
class SceneView:
    """A scene on a page. `update` sends what has changed since the content before."""

    def __init__(self, content: SceneContent) -> None:
        head_style(CSS)
        self._content = content
        self._robot: RobotDrawing | None = None
        with ui.element("div").classes("scene-view"):
            self._problems = ui.label().classes("note").style("white-space: pre-line").props("role=status")
            with ui.element("div").classes("picture"):
                ui.label(_NO_WEBGL).classes("instead")
                self._scene = _scene()
                self._views(content)
            self._posture = ui.label().classes("note")
            self._legend = Legend()
            self._table = ContentTable()
        with self._scene, self._scene.group() as self._root:
            self._scene.axes_helper(0.35)
            self._points = PointMarks()
        self._bodies = BodyDrawing(self._scene, self._root)
        self.update(content)
        look_at_all(self._scene, content, "All", 0.0)

    def _views(self, content: SceneContent) -> None:
        """Buttons that move the camera: around all of the content, and close to each sphere."""
        with ui.element("div").classes("views").props('role=group aria-label="View"'):
            for name in VIEWS:
                command_button(name, lambda name=name: look_at_all(self._scene, self._content, name, 0.4))
            for name in [body.name for body in content.bodies if body.kind is Kind.SPHERE]:
                close = command_button(name, lambda name=name: look_at_sphere(self._scene, self._content, name, 0.4))
                close.props["aria-label"] = f"Close to sphere {name}"

    def update(self, content: SceneContent) -> None:
        """Show `content`; what is as before is not sent again."""
        self._content = content
        self._root.move(0.0, 0.0, round(-0.001 * content.floor_mm, 6))
        self._show_robot(content.posture)
        self._bodies.show(content.bodies, content.floor_mm)
        self._points.show(content.points)
        self._legend.show(content.points)
        self._table.show(content)
        _set_text(self._posture, _posture_text(content))
        _set_text(self._problems, _lines(content.problems))

    def _show_robot(self, posture: Posture | None) -> None:
        if posture is None:
            return
        if self._robot is None:
            with self._scene, self._root:
                self._robot = RobotDrawing(self._scene, posture, self._content.floor_mm)
        self._robot.show(posture)


def scene_view(content: SceneContent) -> SceneView:
    """A scene of `content`, at this place of the page."""
    return SceneView(content)


def _scene() -> ui.scene:
    camera = ui.scene.perspective_camera(fov=FIELD_OF_VIEW_DEG, near=0.05, far=200.0)
    scene = ui.scene(grid=_GRID, camera=camera, background_color=_GROUND, click_events=[])
    text = "3-D scene of the robot and the measured points. The table below has the same content."
    return scene.props(f'role=img aria-label="{text}"')


def _posture_text(content: SceneContent) -> str:
    """Robot, its readings, where they are from, and the grid's size."""
    grid = f"grid {_GRID[0] / _GRID[1]:g} m"
    if content.posture is None:
        return grid
    readings = ", ".join(f"{value:.1f}" for value in content.posture.readings)
    return f"{content.robot} at {readings}° ({content.posture.source}); {grid}"


def _lines(texts: Sequence[str]) -> str:
    return "\n".join(texts)


def _set_text(label: ui.label, text: str) -> None:
    if label.text != text:
        label.set_text(text)
