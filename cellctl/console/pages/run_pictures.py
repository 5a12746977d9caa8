"""3-D scene and charts of a run on its page; they follow the run less often than the rest, which takes less time."""

from __future__ import annotations

import asyncio
import logging
from typing import final

from nicegui import ui

from cellctl.console.live import Snapshot
from cellctl.console.page_commands import set_text
from cellctl.console.scene import SceneContent, Series, scene_of, series_of
from cellctl.console.scene.charts import ChartsView, charts_view
from cellctl.console.scene.view import SceneView, scene_view

_EVERY_S = 0.5
_SHARE = 0.1
"""Largest share of the event loop's time that the content of one run may take."""

Pictures = tuple[SceneContent, Series]


@final
class _Content:
    """Content of the pictures of a run, computed once for all pages, and not too often."""

    def __init__(self) -> None:
        self.events, self.due, self.found = -1, 0.0, None

    events: int
    due: float
    found: Pictures | None

    def of(self, now: Snapshot) -> Pictures | None:
        """The latest content; None if it cannot be computed."""
        time = asyncio.get_running_loop().time
        began = time()
        if self.found is not None and (now.events == self.events or (began < self.due and now.active)):
            return self.found
        try:
            content = scene_of(now.state)
            self.found = content, series_of(now.state, content.points)
        except Exception:  # rows of another version or package: the rest of the page stays
            logging.getLogger(__name__).exception("the pictures of %s cannot be made", now.run)
            self.found = None
        took = time() - began
        self.events, self.due = now.events, began + max(_EVERY_S, took / _SHARE)
        return self.found


_contents: dict[str, _Content] = {}
_KEPT = 8


def _content_of(now: Snapshot) -> Pictures | None:
    content = _contents.pop(str(now.folder), None) or _Content()
    _contents[str(now.folder)] = content  # the one asked for last is the last
    for name in list(_contents)[:-_KEPT]:
        del _contents[name]
    return content.of(now)


@final
class RunPictures:
    """The scene, which can be switched off, above the charts."""

    def __init__(self, snapshot: Snapshot, *, scene: bool) -> None:
        self._now = snapshot
        self._scene: SceneView | None = None
        self._charts: ChartsView | None = None
        self._shown: Pictures | None = None
        self._switch = ui.switch("3-D scene", value=scene, on_change=lambda: self._switched()).props("dense")
        self._note = ui.label().classes("note")
        self._place = ui.element("div")
        self._below = ui.element("div")
        self.show(snapshot)
        self._later = ui.timer(_EVERY_S, lambda: self.show(self._now))

    def show(self, now: Snapshot) -> None:
        """Show the run's content, as new as it is."""
        self._now = now
        found = _content_of(now)
        set_text(self._note, "" if found else "Scene and charts of this run cannot be shown by this version.")
        if found is None or found is self._shown:
            return
        self._shown = found
        content, series = found
        if self._switch.value:
            self._show_scene(content)
        if self._charts is None:
            with self._below:
                self._charts = charts_view(series)
        else:
            self._charts.update(series)

    def _show_scene(self, content: SceneContent) -> None:
        if self._scene is None:
            with self._place:
                self._scene = scene_view(content)
        else:
            self._scene.update(content)

    def _switched(self) -> None:
        if self._switch.value and self._shown:
            self._show_scene(self._shown[0])
        elif not self._switch.value:
            self._place.clear()
            self._scene = None
