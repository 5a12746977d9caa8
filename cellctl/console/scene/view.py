"""The 3-D scene of a run on a page: robot, bodies and points, with views, legend and a table of the same content."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import final

from nicegui import ui

from cellctl.console.look import command_button
from cellctl.console.scene.body_drawing import BodyDrawing
from cellctl.console.scene.camera import FIELD_OF_VIEW_DEG, VIEWS, look_at_all, look_at_sphere
from cellctl.console.scene.content import Kind, SceneContent
from cellctl.console.scene.legend import Legend
from cellctl.console.scene.marks import PointMarks
from cellctl.console.scene.posture import Posture
from cellctl.console.scene.robot_drawing import RobotDrawing
from cellctl.console.scene.table import ContentTable

CSS = (Path(__file__).parent / "scene.css").read_text(encoding="utf-8")

_NO_WEBGL = "This browser draws no 3-D pictures (WebGL is off). The table below has the same content."
"""Behind the picture, which hides it."""

_GROUND = "#f4f6f8"
_GRID = (12, 24)
"""Size of the grid on the floor, m, and its squares along one side."""


@final
class SceneView:
    """A scene on a page. `update` sends what has changed since the content before."""

    def __init__(self, content: SceneContent) -> None:
        ui.add_css(CSS)
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
