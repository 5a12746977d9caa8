"""The page of each history that a package of campaigns brings, `/daily` among them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from cellctl.console.frame import follow, frame
from cellctl.console.shared import console
from cellctl.installed import History, histories


def _add(history: History) -> None:
    @ui.page(f"/{history.name}")
    def page(baseline_runs: int = 0) -> None:
        with frame(history.title, f"/{history.name}"):
            follow(_reader(history, baseline_runs if baseline_runs >= 2 else None))


def _reader(history: History, baseline_runs: int | None) -> Callable[[], Awaitable[None]]:
    """Reads in a thread and shows, if a run of this kind has begun, ended or gone."""
    show, seen = history.view(), None

    async def read() -> None:
        nonlocal seen
        now: Any = [(row.run, row.state) for row in console().live.rows if history.name in row.summary.section]
        if now != seen:
            seen = now
            show(await asyncio.to_thread(history.read, console().runs, baseline_runs))

    return read


for _history in histories():
    _add(_history)
