"""`/run/NAME`: what a run does now: verdict, progress, controls, procedure, 3-D scene, charts, log."""

from __future__ import annotations

from typing import final
from urllib.parse import quote

from fastapi import Request
from fastapi.responses import RedirectResponse
from nicegui import ui

from cellctl.console.following import follow
from cellctl.console.frame import frame
from cellctl.console.live import Snapshot
from cellctl.console.look import facts, link_button, problem_list, section, state_word
from cellctl.console.page_commands import set_text
from cellctl.console.pages.run_controls import RunControls
from cellctl.console.pages.run_log import RunLog
from cellctl.console.pages.run_pictures import RunPictures
from cellctl.console.pages.run_tree import RunTree
from cellctl.console.run_sentence import progress_of, sentence_of
from cellctl.console.shared import console
from cellctl.files import InputError
from cellctl.operations.run_summary import is_simulated


@ui.page("/run")
def active_run(request: Request) -> RedirectResponse | None:
    """Go to the active run, else to the last one."""
    live = console().live
    names = live.active or tuple(row.run for row in live.rows[:1])
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
            problem_list(error.problems)
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
                    "Started": f"{started.calendar.replace('T', ' ').replace('Z', ' UTC')} by {started.operator}",
                    "Seed, clock": f"{started.seed}, {started.clock}",
                    "Folder": str(snapshot.folder),
                }
            )
