"""A page with scene and charts of a made run, which a button continues. Argument: the port."""

from __future__ import annotations

import sys

from nicegui import ui

from cellctl.console.scene import charts_view, scene_of, scene_view, series_of
from cellctl.journal import RunState
from tests.helpers.journals import residuals_row, touch_run

PLANNED, FIRST = 30, 20


def state_after(measured: int) -> RunState:
    """The run after that many touches; after all of them it is identified."""
    run = touch_run(PLANNED, measured)
    if measured == PLANNED:
        readings = [event.data["joints"] for event in run.events[3:]]
        run.row("residuals", residuals_row(readings, [1.0] * PLANNED, [0.01] * PLANNED))
    return run.state()


@ui.page("/")
def _page() -> None:
    measured = [FIRST]
    content = scene_of(state_after(FIRST))
    scene, charts = scene_view(content), charts_view(series_of(state_after(FIRST)))

    def show(count: int) -> None:
        measured[0] = count
        scene.update(scene_of(state_after(count)))
        charts.update(series_of(state_after(count)))
        done.set_text(f"{count} touches")

    ui.button("One more", on_click=lambda: show(measured[0] + 1))
    ui.button("All", on_click=lambda: show(PLANNED))
    done = ui.label(f"{FIRST} touches")


ui.run(host="127.0.0.1", port=int(sys.argv[1]), show=False, reload=False, show_welcome_message=False)
