"""`/run/NAME`: what a run does now: verdict, progress, controls, procedure, 3-D scene, charts, log."""

from __future__ import annotations

import asyncio
import logging
from typing import final
from urllib.parse import quote

from fastapi import Request
from fastapi.responses import RedirectResponse
from nicegui import ui

from cellctl.console.appearance import (
    facts,
    link_button,
    problem_list,
    progress_of,
    section,
    sentence_of,
    shown_time,
    state_word,
)
from cellctl.console.commands import found_rows
from cellctl.console.frame import follow, frame, not_there, set_text
from cellctl.console.live import Snapshot
from cellctl.console.pages.run_parts import RunControls, RunLog, RunNotes, RunTree
from cellctl.console.scene import SceneContent, Series, scene_of, series_of
from cellctl.console.scene.charts import ChartsView, charts_view
from cellctl.console.scene.view import SceneView, scene_view
from cellctl.console.shared import console
from cellctl.files import InputError, Problem
from cellctl.operations.run_list import is_simulated

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


@ui.page("/run")
async def active_run(request: Request) -> RedirectResponse | None:
    """Go to the active run, else to the last one."""
    names = console().live.active or tuple(row.run for row in await found_rows(limit=1))
    if len(names) == 1:
        return RedirectResponse(f"/run/{quote(names[0])}")
    with frame("Run", "/run"):
        ui.label("These runs are active:" if names else "There is no run yet.")
        for name in names:
            link_button(name, f"/run/{quote(name)}")
        if not names:
            link_button("Start a run", "/start", icon="play_arrow")
    return None


@ui.page("/run/{name}", response_timeout=30.0)
async def run(name: str, scene: bool = True) -> None:
    """The run of this name. scene: false begins with the 3-D scene switched off."""
    with frame(name, "/run"):
        try:
            snapshot = await console().live.snapshot(name)
        except InputError as error:
            not_there(error.problems)
            return
        if not snapshot.folder.is_dir():
            not_there([Problem(name, 0, 0, "there is no such run in the folder of this console", "choose one of Runs")])
            return
        page = _RunPage(snapshot, scene=scene)
        follow(page.show, name)


@final
class _RunPage:
    def __init__(self, snapshot: Snapshot, *, scene: bool) -> None:
        self._live = console().live.run(snapshot.run)
        self._problems: tuple[object, ...] = ()
        with ui.element("div").classes("run-head"):
            if snapshot.state.started:
                real = not is_simulated(snapshot.state)
                state_word("warning" if real else "off", "REAL" if real else "SIMULATED")
            with ui.element("div").props("role=status aria-live=polite"):
                self._sentence = state_word("unknown", "", large=True)
            with ui.element("div").classes("run-progress"):
                self._bar = ui.linear_progress(0.0, show_value=False).props("instant-feedback aria-label=Progress")
                self._progress = ui.label()
            self._message = ui.label().classes("note")
            self._problem = ui.element("div").classes("refusals")
            self._controls = RunControls(snapshot)
        with ui.element("div").classes("run-columns"):
            with section("Procedure").classes("run-tree-part"):
                self._tree = RunTree()
            with ui.element("div").classes("section"):
                self._pictures = RunPictures(snapshot, scene=scene)
        with section("Log"):
            self._log = RunLog(snapshot)
        self._facts(snapshot)
        RunNotes(snapshot.folder)
        self.show()

    def show(self) -> None:
        """Show what has changed since the last call."""
        now = self._live.snapshot
        self._sentence.show(*sentence_of(now))
        share, text = progress_of(now)
        if self._bar.value != share:
            self._bar.set_value(share)
        set_text(self._progress, text)
        set_text(self._message, "" if now.status.confirm else now.status.message)
        self._show_problem(now)
        self._controls.show(now)
        self._tree.show(now.tree)
        self._log.show(now)
        self._pictures.show(now)

    def _show_problem(self, now: Snapshot) -> None:
        found = (now.problem, *now.status.broken)
        if found == self._problems:
            return
        self._problems = found
        self._problem.clear()
        with self._problem:
            if now.problem:
                problem_list([now.problem])
            for text in now.status.broken:
                state_word("warning", text)

    def _facts(self, snapshot: Snapshot) -> None:
        started = snapshot.state.started
        if started is None:
            return
        with section("Run"):
            parameters = ", ".join(f"{name} {value}" for name, value in started.parameters.items())
            facts(
                {
                    "Procedure": started.procedure.path,
                    "Cell": started.cell.path,
                    "Parameters": parameters or "none",
                    "Started": f"{shown_time(started.calendar)} by {started.operator}",
                    "Seed, clock": f"{started.seed}, {started.clock}",
                    "Folder": str(snapshot.folder),
                }
            )
