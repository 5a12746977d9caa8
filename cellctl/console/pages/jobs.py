"""`/jobs`: offers to confirm, the queue of each cell, and schedules. They are planned on the page Start."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from datetime import datetime
from functools import partial
from typing import Literal, final
from urllib.parse import quote

from nicegui import ui

from cellctl.console import queue_commands
from cellctl.console.appearance import (
    Cell,
    State,
    command_button,
    figures,
    link_button,
    section,
    shown_time,
    state_word,
    words,
)
from cellctl.console.frame import Commands, answer_of, follow_event, frame
from cellctl.console.pages.planning import DAYS
from cellctl.console.run_queue import Planned, QueuedRun, Schedule, utc_now
from cellctl.console.shared import console
from cellctl.engine import Operator
from cellctl.operations.checking import choices

_OVER = 30
"""Number of the latest started and removed runs on the page."""

_LOOKS: dict[str, State] = {"waiting": "waiting", "started": "good", "lapsed": "bad", "removed": "off"}
_NOTE = "A run starts only when a person at the cell confirms within 10 minutes of its offer. Nothing starts by itself."


@ui.page("/jobs")
def jobs() -> None:
    """The planned runs."""
    with frame("Jobs", "/jobs"):
        page = _JobsPage()
        follow_event(page.show, console().watch.subscribe, "the queue")


@final
class _JobsPage:
    def __init__(self) -> None:
        self._shown: tuple[list[QueuedRun], list[Schedule]] | None = None
        self._commands = Commands()
        with section("Offered now", note=_NOTE):
            self._offers = ui.element("div").classes("section").props("aria-live=polite")
        with section("Queue"):
            self._queue = ui.element("div")
        with section("Schedules"):
            self._schedules = ui.element("div")
        link_button("Plan a run", "/start", icon="playlist_add")

    def show(self) -> None:
        """Show the queue, if it has changed."""
        queue = console().watch.queue
        found = (queue.entries, queue.schedules)
        if found == self._shown:
            return
        self._shown = found
        entries, schedules = found
        offers = [entry for entry in entries if entry.state == "offered"]
        over = [entry for entry in entries if entry.state in ("started", "removed")][-_OVER:]
        listed = [entry for entry in entries if entry.state in ("waiting", "lapsed")] + over[::-1]
        for place in (self._offers, self._queue, self._schedules):
            place.clear()
        with self._offers:
            self._draw_offers(offers)
        with self._queue:
            self._draw_queue(listed)
        with self._schedules:
            self._draw_schedules(schedules)

    def _draw_offers(self, offers: list[QueuedRun]) -> None:
        if not offers:
            ui.label("No run waits for its confirmation.")
        for entry in offers:
            until = datetime.fromisoformat(entry.until).astimezone()
            with ui.element("div").classes("confirm-panel"):
                ui.label(title_of(entry.planned)).classes("confirm-text")
                ui.label(f"{_origin(entry)}. It lapses at {until:%H:%M:%S} if nobody confirms.").classes("note")
                if not self._is_own(entry):
                    continue
                with ui.element("div").classes("row"):
                    command_button(
                        "I am at the cell: start the run",
                        partial(self._confirm, entry),
                        icon="play_arrow",
                        important=True,
                        gives="start",
                    )
                    command_button("Remove", partial(self._change, "remove", entry.id), gives="queue remove")

    def _is_own(self, found: QueuedRun | Schedule) -> bool:
        own = found.host == console().watch.host
        if not own:
            ui.label(f"Of {found.host}: use the console there.").classes("note")
        return own

    def _draw_queue(self, entries: list[QueuedRun]) -> None:
        if not entries:
            ui.label("Nothing is queued.").classes("note")
            return
        rows = [
            (entry.planned.cell, title_of(entry.planned), _origin(entry), self._state(entry), self._buttons(entry))
            for entry in entries
        ]
        figures(words("Cell", "Run", "Queued", "State", "Commands"), rows, label="Queue")

    def _state(self, entry: QueuedRun) -> Callable[[], None]:
        def draw() -> None:
            state_word(_LOOKS[entry.state], entry.state)
            if entry.why:
                ui.label(entry.why).classes("note")
            if entry.run:
                ui.link(entry.run, f"/run/{quote(entry.run)}")
            if entry.who:
                ui.label(f"by {entry.who}, {shown_time(entry.at)}").classes("note")

        return draw

    def _buttons(self, entry: QueuedRun) -> Cell:
        if entry.state not in ("waiting", "lapsed"):
            return "–"

        def draw() -> None:
            if not self._is_own(entry):
                return
            with ui.element("div").classes("row"):
                if entry.state == "lapsed":
                    command_button(
                        "Offer again", lambda: self._change("offer again", entry.id), gives="queue offer again"
                    )
                command_button("Remove", lambda: self._change("remove", entry.id), gives="queue remove")

        return draw

    def _draw_schedules(self, schedules: list[Schedule]) -> None:
        if not schedules:
            ui.label("No run is offered by the clock.").classes("note")
            return
        rows = [
            (each.planned.cell, title_of(each.planned), when_of(each), _next(each), each.by, self._end(each))
            for each in schedules
        ]
        figures(words("Cell", "Run", "Offered at", "Next", "By", "Commands"), rows, label="Schedules")

    def _end(self, schedule: Schedule) -> Cell:
        def draw() -> None:
            if self._is_own(schedule):
                command_button("End", lambda: self._change("unschedule", schedule.id), gives="queue unschedule")

        return draw

    async def _confirm(self, entry: QueuedRun) -> None:
        cells = await asyncio.to_thread(choices, "cell", console().settings.cell)
        cell = cells.get(entry.planned.cell)
        if cell is not None and cell.simulated is False:
            with ui.dialog().props('aria-label="Start on the real cell"') as dialog, ui.card():
                ui.label(f"Start on the real cell '{cell.title}'?").classes("section-title")
                ui.label("The robot will move. Nobody may be inside the guard.")
                with ui.element("div").classes("row"):
                    command_button("Start the run", lambda: dialog.submit(True), important=True)
                    command_button("Cancel", lambda: dialog.submit(False))
            if not await answer_of(dialog):
                return
        await self._commands.give(lambda operator: self._start(operator, entry.id))

    async def _start(self, operator: Operator, number: str) -> None:
        ui.notify("Starting: the run checks again, and connects to its devices …")
        try:
            name = await queue_commands.confirm_offer(operator, number)
        except LookupError:
            return
        ui.navigate.to(f"/run/{quote(name)}")

    async def _change(self, name: Literal["remove", "offer again", "unschedule"], number: str) -> None:
        await self._commands.give(lambda operator: queue_commands.change_queue(operator, name, number))


def title_of(planned: Planned) -> str:
    """What a planned run is, in one line."""
    settings = ", ".join(f"{name} {value}" for name, value in planned.settings.items())
    return f"{planned.procedure} on {planned.cell}" + (f" ({settings})" if settings else "")


def when_of(schedule: Schedule) -> str:
    """`06:00 each day`, `06:00 Mon Tue`."""
    each = "each day" if len(schedule.weekdays) == 7 else " ".join(DAYS[day] for day in schedule.weekdays)
    return f"{schedule.time} {each}, time of {schedule.host}"


def _next(schedule: Schedule) -> str:
    found = schedule.next_after(utc_now())
    return f"{found:%a %H:%M}" if found else "–"


def _origin(entry: QueuedRun) -> str:
    how = f"by the schedule of {entry.by}" if entry.schedule else f"by {entry.by}"
    return f"{shown_time(entry.added)} {how}"
